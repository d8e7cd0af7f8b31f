"""The committed results page against its files, and README's table by hand."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from shaftpose.report.ablation import AblationReport, VariantRow
from shaftpose.report.champion import Champion
from studies import write_results_page as results_page
from studies.write_results_page import readme_table

ROOT = Path(__file__).parents[2]

SOURCES = (
    "reports/ablation.json", "reports/real", "reports/trainings", "reports/sweeps",
    "reports/bundled", "reports/whole_frames", "benchmarks/results", "params.yaml", "conf/variant",
)  # fmt: skip


def changed_results() -> str:
    """The page's sources that differ from git's; a fixed text outside of a git repository."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        return "no git repository"
    command = ["git", "status", "--porcelain", "--", *SOURCES]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_the_committed_page_is_what_its_files_say() -> None:
    if changed := changed_results():
        pytest.skip(f"the page is of other results than those here: {changed}")
    page = results_page.page(ROOT, results_page.records(ROOT), ROOT / "docs")
    assert results_page.PAGE.read_text() == page, "run `make results`"


def test_the_committed_readme_has_the_numbers_of_the_recorded_run() -> None:
    if changed := changed_results():
        pytest.skip(f"its table is of other results than those here: {changed}")
    text = results_page.README.read_text()
    assert results_page.readme(ROOT) == text, "run `make results`"


def test_all_pictures_of_the_page_are_there() -> None:
    pictures = re.findall(r"!\[.*?\]\((.+?)\)", results_page.PAGE.read_text())
    assert pictures
    missing = [name for name in pictures if not (results_page.PAGE.parent / name).is_file()]
    assert missing == []


def row(variant: str, mAP: float | None, title: str = "") -> VariantRow:
    metrics = {"mAP": mAP, "detected_rate": 0.9, "x_mm": 1.5, "z_mm": 1.25, "yaw_deg": None}
    return VariantRow(variant, metrics, 2223, 260, 10, 8, 1.0, 1.0, "muon", 0, (7,), 9, 0, title)


WITH_OTHER_IMAGES = replace(row("d_noise_real", 0.97), mixed_in_images=100)
ROWS = [row("c", 0.8), row("d", 0.9), row("d_noise", None), WITH_OTHER_IMAGES, row("b", 0.95, "B")]
REPORT = AblationReport(ROWS, {}, "stand-in", Champion("c", False, "rule"), "demo")

DEFAULT = {
    "mAP": 0.99, "detected_rate": 0.98, "x_mm": 0.2, "y_mm": 0.3, "z_mm": 0.4, "pitch_deg": None,
    "yaw_deg": 1.0, "axis_deg": 2.0, "tip_mm": 0.5, "images": 1000,
}  # fmt: skip
LAST = "| Default model, ours | 0.990 | 0.980 | 0.20 | 0.30 | 0.40 | n/a | 1.00 |"


SENTENCES = [
    "",
    "Training and test images: 2,223 and 260; in the paper 90,000 and 10,000.",
    "Each of our variants saw 80 images in its training, repetitions included.",
    "Errors are means over the shafts that were found.",
    "The detected rate and the errors are at each model's own confidence threshold; the paper "
    "states none.",
    "The paper is silent on what [we chose](docs/conventions.md#choices): the angles' zero, the "
    "shafts' diameter and number.",
    "The default model was trained on further images, for longer, and tested on 1,000 others.",
]


def test_ours_stand_below_the_papers_of_the_same_name() -> None:
    assert readme_table(REPORT, DEFAULT).splitlines() == [
        "| Variant | mAP | Detected rate | x [mm] | y [mm] | z [mm] | Pitch [deg] | Yaw [deg] |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        "| C, paper | 0.958 | 0.937 | 1.51 | 1.41 | 1.64 | 3.97 | 13.58 |",
        "| C, ours | 0.800 | 0.900 | 1.50 | n/a | 1.25 | n/a | n/a |",
        "| D, paper | 0.949 | 0.956 | 0.81 | 0.76 | 0.81 | 1.57 | 5.30 |",
        "| D, ours | 0.900 | 0.900 | 1.50 | n/a | 1.25 | n/a | n/a |",
        "| D + noise, paper | 0.965 | 0.985 | 0.65 | 0.63 | 0.75 | 1.44 | 4.26 |",
        "| D + noise, ours | n/a | 0.900 | 1.50 | n/a | 1.25 | n/a | n/a |",
        LAST,
        *SENTENCES,
    ]


def test_e_is_shown_with_fitted_poses() -> None:
    rows = [*ROWS[:2], row("e", 0.99, "E"), replace(row("e", 0.98, "E"), refinement="fit")]
    lines = readme_table(replace(REPORT, rows=rows), DEFAULT).splitlines()
    assert lines[5:7] == [
        "| D, ours | 0.900 | 0.900 | 1.50 | n/a | 1.25 | n/a | n/a |",
        "| E + fit, ours | 0.980 | 0.900 | 1.50 | n/a | 1.25 | n/a | n/a |",
    ]


def test_a_variant_that_was_not_run_has_no_row_of_the_paper() -> None:
    lines = readme_table(replace(REPORT, rows=ROWS[4:]), DEFAULT).splitlines()
    assert lines[2:] == [LAST, *SENTENCES]
