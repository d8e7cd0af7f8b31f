"""The README's table: the paper's best variant, those of the recorded run and the default model."""

from shaftpose.figures.markdown import pipe_table
from shaftpose.metrics.metrics import Metrics
from shaftpose.report.ablation import AblationReport
from shaftpose.report.paper_numbers import TABLE_I, TEST_IMAGES, TRAINING_IMAGES
from shaftpose.report.report_tables import TABLE_I_METRICS, beside_paper, cells, paper_cells
from studies.page_tables import with_tables

PAPER, OWN = "d_noise", "e"  # the paper's best variant, and ours that it lacks
COLUMNS = TABLE_I_METRICS[:7]  # up to yaw: what the paper has, too


def with_table(text: str, report: AblationReport, default: Metrics) -> str:
    """The README with its table up to date, see `table`. Raises InputError if it lacks the
    markers."""
    return with_tables(text, {"results": table(report, default)}, "make results", "README.md")


def table(report: AblationReport, default: Metrics) -> str:
    """The README's table, and a sentence on the numbers of images.

    Its rows: the paper's best variant on renders; ours with the best mAP among those of the paper
    that were trained on renders alone; the refined poses of `OWN`, if it was run; the default
    model.
    """
    in_paper = [row for row in report.rows if row.variant in TABLE_I and not row.mixed_in_images]
    best = sorted(in_paper, key=lambda row: row.metrics["mAP"] or 0.0)[-1:]
    ours = [*best, *(row for row in report.rows if row.variant == OWN and row.refined)]
    rows = [[f"{TABLE_I[PAPER].title}, paper", *(paper_cells(PAPER, COLUMNS) or [])]]
    for row in beside_paper(ours, report.domain_label, COLUMNS):
        rows.append([f"{row.title}, ours", *row.ours])
    rows.append(["Default model, ours", *cells(default.as_dict(), COLUMNS)])
    headings = ["Variant", *(column.heading for column in COLUMNS)]
    images = f"{report.rows[0].training_images:,} and {report.rows[0].test_images:,}"
    return (
        f"{pipe_table(headings, rows)}\n\nErrors are means. Training and test images: "
        f"{images}; in the paper {TRAINING_IMAGES:,} and {TEST_IMAGES:,}.\n"
        f"The default model was tested on {default.images:,} others."
    )
