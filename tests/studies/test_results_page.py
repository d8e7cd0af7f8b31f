"""The committed results page and README's table against the files that they are made from."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from studies import write_results_page as results_page

ROOT = Path(__file__).parents[2]

SOURCES = (
    "reports/ablation.json", "reports/real", "reports/trainings", "reports/sweeps",
    "reports/bundled", "benchmarks/results", "params.yaml", "conf/variant",
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
    assert results_page.PAGE.read_text() == results_page.page(ROOT, results_page.records(ROOT)), (
        "run `make results`"
    )


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
