"""The README's table: the paper's best variant, those of the recorded run and the default model."""

from shaftpose.figures.markdown import pipe_table
from shaftpose.metrics.table import MetricValues, metrics_of
from shaftpose.report.ablation import AblationReport
from shaftpose.report.cells import cells, headings, show
from shaftpose.report.paper_numbers import TABLE_I, TEST_IMAGES, TRAINING_IMAGES
from studies.page_tables import with_tables

PAPER, OWN = "d_noise", "e"  # the paper's best variant, and ours that it lacks
COLUMNS = tuple(metric for metric in metrics_of("detection", "pose") if metric.in_paper)


def with_table(text: str, report: AblationReport, default: MetricValues) -> str:
    """The README with its table up to date, see `table`. Raises InputError if it lacks the
    markers."""
    return with_tables(text, {"results": table(report, default)}, "make results", "README.md")


def table(report: AblationReport, default: MetricValues) -> str:
    """The README's table, and a sentence on the numbers of images.

    Its rows: the paper's best variant on renders; ours with the best mAP among those of the paper
    that were trained on renders alone; the refined poses of `OWN`, if it was run; the default
    model.
    """
    in_paper = [row for row in report.rows if row.variant in TABLE_I and not row.mixed_in_images]
    best = sorted(in_paper, key=lambda row: row.metrics["mAP"] or 0.0)[-1:]
    ours = [*best, *(row for row in report.rows if row.variant == OWN and row.refined)]
    rows = [[f"{TABLE_I[PAPER].title}, paper", *cells(vars(TABLE_I[PAPER]), COLUMNS)]]
    for row in ours:
        title = row.title_cell(report.domain_label)
        rows.append([f"{title}, ours", *cells(row.metrics, COLUMNS, row.spread)])
    rows.append(["Default model, ours", *cells(default, COLUMNS)])
    images = f"{report.rows[0].training_images:,} and {report.rows[0].test_images:,}"
    return (
        f"{pipe_table(['Variant', *headings(COLUMNS)], rows)}\n\nErrors are means. "
        f"Training and test images: {images}; "
        f"in the paper {TRAINING_IMAGES:,} and {TEST_IMAGES:,}.\n"
        f"The default model was tested on {show(default['images'], 0)} others."
    )
