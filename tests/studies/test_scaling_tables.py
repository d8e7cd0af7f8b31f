"""Times, sizes and verdicts of the tables of docs/scaling.md, by hand."""

import json
from pathlib import Path
from typing import Any

import pytest

from studies import scaling_tables
from studies.scaling_tables import (
    DURATIONS,
    PAGE,
    SIZES,
    Measured,
    aims_table,
    cost_table,
    page,
    profile_table,
    quality_table,
    rounded,
)

# 2 workers, 10 images/s: 0.2 core-seconds each.
FOUND: dict[str, Any] = {
    "images_per_s": 10.0,
    "psnr_db": 31.47,
    "speedup_vs_plain": 46.2,
    "two_worker_speedup": 1.75,
    "rss_growth": 0.05,
    "rss_mib": 385.0,
    "bytes_per_image": 90_000,
    "workers": 2,
    "machine": {"cores": 2},
    "settings": {"samples": 6, "seed": 1},
    "parts": {
        "quality": {
            "curve": [
                {"samples": 6, "psnr_db": 31.47, "psnr_db_least": 20.0, "seconds": 0.16},
                {"samples": 32, "psnr_db": 38.2, "psnr_db_least": 30.0, "seconds": 0.5},
                {"samples": 64, "psnr_db": 41.0, "psnr_db_least": 32.0, "seconds": 1.0},
            ]
        },
        "profile": {"milliseconds": {"annotation": 30.0, "path tracing": 120.0}, "images": 5},
        "plain": {"plain_s": 3.0, "ours_s": 0.08},
    },
}


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The benchmark's results file read by the module."""
    path = tmp_path / "render.json"
    path.write_text(json.dumps(FOUND))
    monkeypatch.setattr(scaling_tables, "RESULTS", path)
    return path


@pytest.fixture
def measured(results: Path) -> Measured:
    return scaling_tables.read_measured()


def test_costs_by_hand(measured: Measured) -> None:
    """1e5 images: 2e4 s = 5.6 h on one core."""
    assert cost_table(measured).splitlines() == [
        "At 6 samples per pixel: 10 images/s with 2 workers, a core each:",
        "0.2 core-seconds and 90 kB per image.",
        "",
        "| images | storage | 1 core | 16 cores | 1,000 cores |",
        "| --- | --- | --- | --- | --- |",
        "| 100 thousand | 9.0 GB | 5.6 hours | 21 minutes | 20 seconds |",
        "| 10 million | 900 GB | 23 days | 35 hours | 33 minutes |",
        "| 1 billion | 90 TB | 6.3 years | 145 days | 2.3 days |",
    ]


def test_aims_by_hand(measured: Measured) -> None:
    rows = [line.strip("|").split("|")[1:] for line in aims_table(measured).splitlines()[4:]]
    assert [[cell.strip() for cell in row] for row in rows] == [
        [">= 10", "10", "met"],
        [">= 38", "31.47", "missed"],
        [">= 15", "46.2", "met"],
        [">= 1.8", "1.75", "missed"],
        ["< 0.05", "0.05", "missed"],
        ["< 1024", "385", "met"],
    ]


def test_the_profile_has_the_longest_step_first(measured: Measured) -> None:
    assert profile_table(measured).splitlines()[2:] == [
        "| path tracing | 120.0 | 80% |",
        "| annotation | 30.0 | 20% |",
    ]


def test_the_price_of_quality_by_hand(measured: Measured) -> None:
    """32 samples: 1e5 images of 0.5 s on 16 cores, 52 min; two workers: 1.75 / 0.5 = 3.5 images/s;
    a plain script takes 3 s per image."""
    *_, middle, _, _, price = quality_table(measured).splitlines()
    assert middle == "| 32 | 38.2 | 0.500 | 52 minutes |"
    assert price.startswith(
        "At the 32 samples that 38 dB take, two workers would render 3.5 images/s, 10 times as many"
    )


@pytest.mark.parametrize(
    ("value", "units", "text"),
    [
        (0.4, DURATIONS, "0.4 seconds"),
        (119.0, DURATIONS, "119 seconds"),
        (120.0, DURATIONS, "2.0 minutes"),
        (4e10, DURATIONS, "1,268 years"),
        (1_999.0, SIZES, "1,999 bytes"),
        (2_000.0, SIZES, "2.0 kB"),
    ],
)
def test_units(value: float, units: dict[str, int], text: str) -> None:
    assert rounded(value, units) == text


def test_main_fills_the_page(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = tmp_path / "scaling.md"
    copy.write_text(PAGE.read_text())
    monkeypatch.setattr(scaling_tables, "PAGE", copy)
    scaling_tables.main()
    assert "| 1 billion | 90 TB |" in copy.read_text()
    results.unlink()
    with pytest.raises(SystemExit, match="make bench-render"):
        scaling_tables.main()


def test_the_page_shows_what_was_measured() -> None:
    text = PAGE.read_text()
    assert page(text, scaling_tables.read_measured()) == text
