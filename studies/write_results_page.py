"""Write docs/results.md, its pictures of repeated trainings, README's table and that of
docs/real_images.md: `make results`.

All content comes from the result files in the repository; the rounding errors of pose classes come
from the variants' files.
"""

import argparse
import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from shaftpose.core.errors import exit_on_input_error
from shaftpose.core.files import new_file, read_json
from shaftpose.figures.markdown import pipe_table
from shaftpose.figures.style import save_figure
from shaftpose.metrics.table import MetricValues, metrics_of
from shaftpose.report.ablation import AblationReport, VariantRow
from shaftpose.report.cells import cells, headings, show
from shaftpose.report.paper_numbers import TABLE_I, TEST_IMAGES, TRAINING_IMAGES
from shaftpose.stage_files import read_stage_file
from shaftpose.sweeps.table import read_table, sweep_figures
from studies.architecture_tables import rounding_table
from studies.bundled_errors import recorded
from studies.frame_tables import frame_blocks
from studies.pages import with_tables
from studies.palette_pictures import store_with_palette
from studies.record import EvaluatedTraining, read_record
from studies.results_page import Table, to_page
from studies.table import PICTURES, repeated_figures
from studies.whole_frames.record import tables as whole_frame_tables

ROOT = Path(__file__).parents[1]
PAGE, README, REAL = ROOT / "docs/results.md", ROOT / "README.md", ROOT / "docs/real_images.md"
PAPER, OWN = ("c", "d", "d_noise"), "e"  # in README's table: the paper's variants, and ours
COLUMNS = tuple(metric for metric in metrics_of("detection", "pose") if metric.in_paper)


def main() -> None:
    """Write the page and its pictures, and the tables of README and of real frames.

    With `--out FOLDER`, for results of one's own, writes the page and its pictures there alone.
    """
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, help="folder for the page alone")
    out = parser.parse_args().out
    with exit_on_input_error():
        trainings = records(ROOT)
        if out is not None:
            write_page(trainings, out / PAGE.name)
            print(f"written to {out / PAGE.name}")
            return
        write_page(trainings, PAGE)
        README.write_text(readme(ROOT))
        REAL.write_text(real_images(ROOT))
    print(f"written to {PAGE.relative_to(ROOT)}, {README.name} and {REAL.relative_to(ROOT)}")


def write_page(trainings: Sequence[EvaluatedTraining], path: Path) -> None:
    """Write the page with its pictures."""
    with new_file(path) as part:
        part.write_text(page(ROOT, trainings, path.parent))
    draw(repeated_figures(trainings) | swept_figures(ROOT), path.parent)


def swept_figures(root: Path) -> dict[str, Figure]:
    """The first figure of each sweep below `root`."""
    paths = (root / "reports/sweeps").glob("*.csv")
    figures = {path.stem: sweep_figures(read_table(path)) for path in paths}
    return {f"images/sweep-{name}.png": next(iter(one.values())) for name, one in figures.items()}


def draw(figures: Mapping[str, Figure], folder: Path) -> None:
    """Draw the figures, given by path in `folder`, and remove those of other records."""
    for name, figure in figures.items():
        save_figure(figure, folder / name)
        store_with_palette(folder / name)
    drawn = {folder / name for name in figures}
    for path in [found for kind in PICTURES for found in folder.glob(f"images/{kind}_*.png")]:
        if path not in drawn:
            path.unlink()


def page(root: Path, trainings: Sequence[EvaluatedTraining], folder: Path) -> str:
    """The page in `folder` for single trainings and the results below `root`."""
    benchmarks = contents(root / "benchmarks/results")
    docs = "" if folder == PAGE.parent else f"{os.path.relpath(PAGE.parent, folder)}/"
    return to_page(
        report_of(root), trainings, rounding_table(), sweeps(root), benchmarks,
        whole_frame_tables(root), docs,
    )  # fmt: skip


def readme(root: Path) -> str:
    """README with the table of the results below `root`."""
    tables = {"results": readme_table(report_of(root), recorded(root))}
    return with_tables((root / README.name).read_text(), tables, "make results", README.name)


def real_images(root: Path) -> str:
    """The page of real images with the tables of whole frames recorded below `root`."""
    page = (root / "docs" / REAL.name).read_text()
    return with_tables(page, {"frames": frame_blocks(root)}, "make results", REAL.name)


def readme_table(report: AblationReport, default: MetricValues) -> str:
    """The README's table, and sentences on how its numbers came about.

    Its rows: the paper's variants that were trained on renders alone, each beside ours of the same
    name; the refined poses of `OWN`, if it was run; the default model.
    """
    ours = {row.variant: row for row in report.rows if row.paper and not row.mixed_in_images}
    rows = []
    for variant in (name for name in PAPER if name in ours):
        rows.append([f"{TABLE_I[variant].title}, paper", *cells(vars(TABLE_I[variant]), COLUMNS)])
        rows.append(_own(ours[variant], report))
    rows += [_own(row, report) for row in report.rows if row.variant == OWN and row.refined]
    rows.append(["Default model, ours", *cells(default, COLUMNS)])
    sentences = _readme_sentences(report.rows, default)
    return f"{pipe_table(['Variant', *headings(COLUMNS)], rows)}\n\n{sentences}"


def _own(row: VariantRow, report: AblationReport) -> list[str]:
    title = row.title_cell(report.domain_label)
    return [f"{title}, ours", *cells(row.metrics, COLUMNS, row.spread)]


def _readme_sentences(rows: Sequence[VariantRow], default: MetricValues) -> str:
    row = rows[0]
    shown = row.batch_size * row.steps
    detector = row.batch_size * max(one.detector_steps for one in rows)
    before = (
        f"; our C, D and D + noise started from a detector that had seen {detector:,}"
        if detector
        else ""
    )
    return (
        f"Training and test images: {row.training_images:,} and {row.test_images:,}; in the paper "
        f"{TRAINING_IMAGES:,} and {TEST_IMAGES:,}.\n"
        f"Each of our variants saw {shown:,} images in its training, repetitions included"
        f"{before}.\n"
        "Errors are means over the shafts that were found.\n"
        "The detected rate and the errors are at each model's own confidence threshold; the paper "
        "states none.\n"
        "The paper is silent on what [we chose](docs/conventions.md#choices): the angles' "
        "zero, the shafts' diameter and number.\n"
        "The default model was trained on further images, for longer, and tested on "
        f"{show(default['images'], 0)} others."
    )


def records(root: Path) -> list[EvaluatedTraining]:
    """The records of single trainings, sorted by variant and seed."""
    found = [read_record(path) for path in sorted((root / "reports/trainings").glob("*.json"))]
    return sorted(
        found, key=lambda record: (record.row.variant, record.row.refined, record.row.seeds)
    )


def sweeps(root: Path) -> dict[str, Table]:
    """The tables of sweeps by name."""
    found = sorted((root / "reports/sweeps").glob("*.csv"))
    return {path.stem: list(csv.reader(path.read_text().splitlines())) for path in found}


def report_of(root: Path) -> AblationReport:
    """The recorded report. Raises InputError if there is none, or one of another version."""
    return read_stage_file(root / "reports/ablation.json", AblationReport, "run `make report`")


def contents(folder: Path) -> dict[str, Any]:
    """The JSON files of a folder by name."""
    remedy = "restore it from git, or generate it again"
    return {path.stem: read_json(path, remedy) for path in sorted(folder.glob("*.json"))}


if __name__ == "__main__":
    main()
