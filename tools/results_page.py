"""Write docs/results.md and draw its pictures of repeated trainings: `make results`.

All of it comes from the files of results that are in the repository.
"""

import csv
import json
import sys
from pathlib import Path
from typing import Any

from shaftpose.errors import InputError
from shaftpose.evaluation.ablation import AblationReport, Champion
from shaftpose.evaluation.figure_style import save_figure
from shaftpose.evaluation.repeated_trainings import repeated_figures
from shaftpose.evaluation.results_page import Table, to_page
from shaftpose.evaluation.training_record import TrainingRecord, part_of, read_record, read_row

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/results.md"


def main() -> None:
    """Write the page and its pictures."""
    try:
        PAGE.write_text(page(ROOT))
        for name, figure in repeated_figures(records(ROOT), report_of(ROOT).domain_label).items():
            save_figure(figure, PAGE.parent / name)
    except InputError as error:
        sys.exit(f"error: {error}")
    print(f"written to {PAGE.relative_to(ROOT)}")


def page(root: Path) -> str:
    """The page of the results below `root`."""
    benchmarks = contents(root / "benchmarks/results")
    return to_page(report_of(root), records(root), sweeps(root), benchmarks)


def records(root: Path) -> list[TrainingRecord]:
    """What is kept of single trainings, by variant and seed."""
    found = [
        read_record(content, f"reports/trainings/{name}.json")
        for name, content in contents(root / "reports/trainings").items()
    ]
    return sorted(found, key=lambda record: (record.row.variant, record.row.seeds))


def sweeps(root: Path) -> dict[str, Table]:
    """The tables of sweeps by name."""
    found = sorted((root / "reports/sweeps").glob("*.csv"))
    return {path.stem: list(csv.reader(path.read_text().splitlines())) for path in found}


def report_of(root: Path) -> AblationReport:
    """The recorded report. Raises InputError if there is none, or one of an older version."""
    recorded = root / "reports/ablation.json"
    if not recorded.is_file():
        raise InputError(f"{recorded}: missing; run `make report`")
    content = json.loads(recorded.read_text())
    return read_report(content, str(recorded))


def read_report(content: dict[str, Any], file: str) -> AblationReport:
    """The report that the pipeline wrote as ablation.json; `file` is its place, for messages."""
    return AblationReport(
        rows=[read_row(row) for row in content["variants"]],
        constant=content["constant_predictor"],
        silhouette=content["silhouette"],
        domain_label=content["domain_label"],
        champion=Champion(**content["champion"]),
        profile=part_of(content, "profile", file),
    )


def contents(folder: Path) -> dict[str, Any]:
    """The JSON files of a folder by name."""
    return {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}


if __name__ == "__main__":
    main()
