"""Write docs/results.md and draw its pictures of repeated trainings: `make results`.

All of it comes from the files of results that are in the repository, and what classes cost from
the variants' files.
"""

import csv
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "pipelines"), str(ROOT / "tools")]

from architecture_tables import rounding_table  # noqa: E402
from results import read_json  # noqa: E402

from shaftpose.errors import InputError  # noqa: E402
from shaftpose.evaluation.ablation import AblationReport, Champion  # noqa: E402
from shaftpose.evaluation.figure_style import save_figure  # noqa: E402
from shaftpose.evaluation.repeated_trainings import PICTURES, repeated_figures  # noqa: E402
from shaftpose.evaluation.results_page import Table, to_page  # noqa: E402
from shaftpose.evaluation.training_record import TrainingRecord, read_record, read_row, whole  # noqa: E402

PAGE = ROOT / "docs/results.md"


def main() -> None:
    """Write the page and its pictures."""
    try:
        PAGE.write_text(page(ROOT))
        draw(repeated_figures(records(ROOT)), PAGE.parent)
    except InputError as error:
        sys.exit(f"error: {error}")
    print(f"written to {PAGE.relative_to(ROOT)}")


def draw(figures: Mapping[str, Figure], folder: Path) -> None:
    """Draw the figures, given by their path in a folder, and remove those of other records."""
    for name, figure in figures.items():
        save_figure(figure, folder / name)
    drawn = {folder / name for name in figures}
    for path in [found for kind in PICTURES for found in folder.glob(f"images/{kind}_*.png")]:
        if path not in drawn:
            path.unlink()


def page(root: Path) -> str:
    """The page of the results below `root`."""
    benchmarks = contents(root / "benchmarks/results")
    return to_page(report_of(root), records(root), rounding_table(), sweeps(root), benchmarks)


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
    """The recorded report. Raises InputError if there is none, or one of another version."""
    recorded, remedy = root / "reports/ablation.json", "run `make report`"
    content = read_json(recorded, remedy)
    with whole(str(recorded), remedy):
        return read_report(content)


def read_report(content: dict[str, Any]) -> AblationReport:
    """The report that the pipeline wrote as ablation.json."""
    return AblationReport(
        rows=[read_row(row) for row in content["variants"]],
        constant=content["constant_predictor"],
        silhouette=content["silhouette"],
        domain_label=content["domain_label"],
        champion=Champion(**content["champion"]),
        profile=content["profile"],
    )


def contents(folder: Path) -> dict[str, Any]:
    """The JSON files of a folder by name."""
    remedy = "take it from git, or make it again"
    return {path.stem: read_json(path, remedy) for path in sorted(folder.glob("*.json"))}


if __name__ == "__main__":
    main()
