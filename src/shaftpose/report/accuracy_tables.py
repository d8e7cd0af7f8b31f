"""Accuracy on the rendered test images, as Markdown: Table I, spread of errors, bias of depth."""

from collections.abc import Sequence

from shaftpose.figures.markdown import pipe_table
from shaftpose.figures.variant_figures import FEWEST
from shaftpose.metrics.binned_errors import ErrorBin
from shaftpose.metrics.summary import Summary
from shaftpose.metrics.table import Metric, metrics_named, metrics_of
from shaftpose.report import paper_numbers
from shaftpose.report.ablation import AblationReport, VariantRow
from shaftpose.report.cells import (
    MISSING,
    cells,
    headings,
    paired,
    show,
    show_interval,
    show_span,
)
from shaftpose.stage_files import STAND_IN

ACCURACY = metrics_of("detection", "pose")
SPREAD_ERRORS = (*metrics_named("tip_mm", "axis_deg"), *metrics_of("rod"))
SPREAD = (
    "mAP and detected rate: 95 % confidence intervals (bootstrap over test images). Errors: "
    "median; 95th percentile (interval of the mean). ADD-S, and the BOP benchmark's "
    "MSSD and MSPD, are of the 10 mm of the shaft next to its tip."
)
DEPTHS = (
    "Median of estimated minus true depth (z) of the detected instruments in mm, by true depth, "
    f"for depths with at least {FEWEST} of them. "
    "Near shafts that are taken for farther ones make it positive, far ones that are taken for "
    "nearer ones negative."
)


def table_i(report: AblationReport) -> str:
    """All rows of the report with the paper's values, and the constant predictor."""
    columns = (*ACCURACY, *metrics_of("speed"))
    constant = ["Constant predictor", MISSING, MISSING, *cells(report.constant, columns)]
    return rows_beside_paper(report.rows, report.domain_label, columns, report.best, constant)


def rows_beside_paper(
    rows: Sequence[VariantRow],
    domain: str,
    columns: Sequence[Metric],
    best: VariantRow | None = None,
    *further: Sequence[str],
) -> str:
    """Rows of Table I, "paper / ours", with `±` half the range if trained more than once.

    best: set in bold; further: rows of cells below.
    """
    lines = [
        [row.title_cell(domain, row is best), *_scale(row), *paper_and_ours(row, columns)]
        for row in rows
    ]
    names = ["Variant", "Training images", "Steps", *headings(columns)]
    return pipe_table(names, [*lines, *further])


def _scale(row: VariantRow) -> list[str]:
    """Training images and steps; the paper states no steps."""
    paper = (show(paper_numbers.TRAINING_IMAGES, 0), MISSING) if row.paper else None
    return paired(paper, [show(row.training_images, 0), show(row.steps, 0)])


def paper_and_ours(row: VariantRow, columns: Sequence[Metric]) -> list[str]:
    """The metrics of a row, the paper's first."""
    paper = cells(vars(row.paper), columns) if row.paper else None
    return paired(paper, cells(row.metrics, columns, row.spread))


def notes_on_table_i(report: AblationReport) -> list[str]:
    """Sentences on the scale of Table I, the paper's and ours."""
    rows = report.rows
    share = max((row.training_images for row in rows), default=0) / paper_numbers.TRAINING_IMAGES
    notes = [
        f"Paper: {paper_numbers.TRAINING_IMAGES:,} artificial training images (and "
        f"{paper_numbers.REAL_TRAINING_IMAGES} real ones in D + noise + real), "
        f"{paper_numbers.TEST_IMAGES:,} test images, batch {paper_numbers.BATCH_SIZE}; the number "
        "of steps is not stated. Its fps were measured on a Quadro GV100. Ours are a single "
        "reading with onnxruntime on a CPU, one image at a time, including decoding and, for E + "
        "fit, the fit; `make bench` measures the speed in repeated rounds. Poses of 8 views are "
        "means over the image's eight mirrored and turned copies.",
        f"Ours: {show_span(r.training_images for r in rows)} training images (at most "
        f"{100 * share:.3g} % of the paper's), {show_span(r.test_images for r in rows)} test "
        f"images, {show_span(r.steps for r in rows)} steps, batch "
        f"{show_span(r.batch_size for r in rows)}, backbone width "
        f"{show_span(r.width for r in rows)}, depth {show_span(r.depth for r in rows)}.",
        "Errors are means over the detected instruments. The constant predictor returns the "
        "training set's mean box and pose for every image; its errors are means over all "
        f"instruments. {MISSING}: not measured, not stated or not defined.",
    ]
    notes += [_mixed_in(row, report.domain_label) for row in rows if row.mixed_in_images]
    if any(len(row.seeds) < 2 for row in rows):
        notes.append(
            "Variants with one seed were trained once, so this run does not show how large random "
            "differences are. docs/results.md lists repeated trainings."
        )
    return notes


def _mixed_in(row: VariantRow, domain: str) -> str:
    """Sentence on the number of real or stand-in images that a variant was trained on."""
    images = f"{row.mixed_in_images:,} {domain} images"
    sentence = f"{row.title_cell(domain)}: {images} were mixed in with the rendered ones"
    if domain == STAND_IN and row.paper:
        sentence += f"; the paper's {row.paper.title} has real ones"
    return f"{sentence}."


def spread_table(report: AblationReport) -> str | None:
    """Intervals, medians and 95th percentiles of each row that has them; None without any."""
    rows = [
        [
            row.title_cell(report.domain_label),
            show_interval(row.summary.mAP, 3),
            show_interval(row.summary.detected_rate, 3),
            show(row.summary.detected_rate_at_half, 3),
            *(_error_cell(row.summary, metric) for metric in SPREAD_ERRORS),
        ]
        for row in report.rows
        if row.summary
    ]
    names = ["Variant", "mAP", "Detected rate", "Detected rate at 0.5", *headings(SPREAD_ERRORS)]
    return pipe_table(names, rows) if rows else None


def _error_cell(summary: Summary, metric: Metric) -> str:
    error = summary.errors.get(metric.name)
    if error is None:
        return MISSING
    shown = (error.median, error.p95, *error.interval)
    return "{}; {} ({} to {})".format(*(show(value, metric.digits) for value in shown))


def depth_table(report: AblationReport) -> str | None:
    """The bias of the depth of each row that has it, by true depth; None without any."""
    bins = next((row.depths for row in report.rows if row.depths), ())
    names = ["Variant", *(f"{one.low:g} to {one.high:g} mm" for one in bins)]
    rows = [[row.title_cell(report.domain_label), *map(_bias, row.depths)] for row in report.rows]
    known = [row for row in rows if set(row[1:]) - {MISSING}]
    return pipe_table(names, known) if known else None


def _bias(depth: ErrorBin) -> str:
    bias = depth.z_bias_mm if depth.count >= FEWEST else None
    return MISSING if bias is None else f"{bias:+.2f}"
