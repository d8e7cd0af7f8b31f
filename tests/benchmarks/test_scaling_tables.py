"""Times and sizes of the scaling table, by hand."""

import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

import scaling_table  # noqa: E402
from scaling_table import BEGIN, DURATIONS, END, PAGE, SIZES, Measured, filled, rounded, table  # noqa: E402

from shaftpose.config import from_json  # noqa: E402
from shaftpose.errors import InputError  # noqa: E402


def test_rows_by_hand() -> None:
    # 2 workers, 10 images/s: 0.2 core-seconds each. 1e5 images: 2e4 s = 5.6 h on one core.
    text = table(Measured(images_per_s=10.0, bytes_per_image=90_000.0, workers=2))
    assert "10 images/s with 2 workers" in text
    assert "0.2 core-seconds" in text
    assert text.splitlines()[-5:] == [
        "| images | storage | 1 core | 16 cores | 1,000 cores |",
        "|---|---|---|---|---|",
        "| 100 thousand | 9.0 GB | 5.6 hours | 21 minutes | 20 seconds |",
        "| 10 million | 900 GB | 23 days | 35 hours | 33 minutes |",
        "| 1 billion | 90 TB | 6.3 years | 145 days | 2.3 days |",
    ]


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


def test_a_table_is_replaced_and_the_rest_stays() -> None:
    page = f"before\n{BEGIN}\nold\n{END}\nafter\n"
    assert filled(page, "new") == f"before\n{BEGIN}\nnew\n{END}\nafter\n"
    with pytest.raises(InputError, match="table"):
        filled(f"before {BEGIN} without an end", "new")


def test_main_fills_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results, page = tmp_path / "render.json", tmp_path / "scaling.md"
    page.write_text(PAGE.read_text())
    monkeypatch.setattr(scaling_table, "RESULTS", results)
    monkeypatch.setattr(scaling_table, "PAGE", page)
    with pytest.raises(SystemExit, match="make bench-render"):
        scaling_table.main()
    values = {"images_per_s": 8.0, "bytes_per_image": 1e5, "workers": 2, "host": "a machine"}
    results.write_text(json.dumps(values))
    scaling_table.main()
    assert "| 1 billion | 100 TB |" in page.read_text()


def test_the_page_shows_what_was_measured() -> None:
    page = PAGE.read_text()
    if scaling_table.RESULTS.exists():
        measured = from_json(Measured, scaling_table.RESULTS)
        assert filled(page, table(measured)) == page
    else:
        assert "make bench-render" in page.partition(BEGIN)[2].partition(END)[0]
