"""Repeated trainings on the results page: tables, verdicts and pictures."""

from collections.abc import Sequence
from dataclasses import replace

from matplotlib.figure import Figure

from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.evaluation.common_instruments import common_instruments, means_on
from shaftpose.figures.binned_errors_figure import binned_error_figure
from shaftpose.figures.learning_curves_figure import learning_curve_figure
from shaftpose.report import report_tables
from shaftpose.report.ablation import STAND_IN, VariantRow, variant_title
from shaftpose.report.report import pipe_table, table_i_block
from shaftpose.report.report_tables import TABLE_I_METRICS
from studies import paper_order
from studies.aggregate import Scale, by_scale, distinctions, rows_of
from studies.record import TrainingRecord

INTRO = (
    "All trainings that `studies.evaluate_trainings` recorded in `reports/trainings`. Cells show "
    "paper / ours; ours are means ± half the range over the seeds. Detected rate and errors use "
    "each model's own confidence threshold, the one with the best F1 on the validation images. "
    "Errors are means over the detected instruments."
)
ORDER = (
    "Change of each metric in each step of the paper's study, and whether the paper reports the "
    "same direction. A difference within the spread is no larger than the sum of both half ranges "
    "(for a variant trained once: the largest known half range). A larger difference is a hint, "
    "not a proof: with so few trainings, it is often due to chance. For B the paper states only "
    "that rotations in steps of 5 deg are not precise enough; the rounding errors of classes are "
    "[below](#rounding-errors-of-pose-classes). Errors are those on the same instruments. "
    "[ablation.md](ablation.md) discusses the conclusions and possible reasons."
)
COMMON = (
    "The same errors on the same instruments: the {count:,} of {total:,} that all these trainings "
    "detected. (In the table above, a variant that also detects hard instruments may have larger "
    "errors for that reason.)"
)
CURVES = (
    "Learning curves on the validation images, one line for each training. The pose loss of "
    "classes (cross-entropy) is not comparable with that of numbers."
)
COMMON_COLUMNS = tuple(
    column for column in TABLE_I_METRICS if column.name in (*POSE_DIMENSIONS, "axis_deg", "tip_mm")
)
DECIMALS = {column.name: column.decimals for column in TABLE_I_METRICS}
HEADINGS = {column.name: column.heading for column in TABLE_I_METRICS}


# Prefixes of picture names.
CURVES_PICTURE, ERRORS_PICTURE = "curves", "errors"
PICTURES = (CURVES_PICTURE, ERRORS_PICTURE)


def repeated_blocks(records: Sequence[TrainingRecord]) -> list[str]:
    """Blocks of Markdown for each scale of these trainings; if there are several, headings state
    their differences."""
    parts, scales = [INTRO], by_scale(records)
    for (scale, alike), own in zip(scales.items(), distinctions(list(scales)), strict=True):
        parts += [f"### {own}"] if own else []
        parts += _of_scale(scale, alike)
    return parts


def repeated_figures(records: Sequence[TrainingRecord]) -> dict[str, Figure]:
    """Learning curves of all trainings of a scale, and binned errors of one of each variant, by
    path relative to the page."""
    found = {}
    for scale, alike in by_scale(records).items():
        by_title: dict[str, list[TrainingRecord]] = {}
        for record in alike:
            title = variant_title(record.row.variant, _domain_of(alike), record.row.title)
            by_title.setdefault(title, []).append(record)
        found[_picture(CURVES_PICTURE, scale)] = learning_curve_figure(
            {title: [one.curves for one in repeats] for title, repeats in by_title.items()}
        )
        found[_picture(ERRORS_PICTURE, scale)] = binned_error_figure({
            f"{title}, seed {first.row.seeds[0]}": first.binned_errors
            for title, (first, *_) in by_title.items()
        })  # fmt: skip
    return found


def _domain_of(alike: Sequence[TrainingRecord]) -> str:
    """The domain of the trainings' real images; no title uses it if there are none."""
    return next((record.real["domain"] for record in alike if record.real), STAND_IN)


def _of_scale(scale: Scale, alike: Sequence[TrainingRecord]) -> list[str]:
    rows, domain_label = rows_of(alike), _domain_of(alike)
    columns = report_tables.TRAINING_COLUMNS
    compared = report_tables.beside_paper(rows, domain_label, columns)
    seeds = "; ".join(
        f"{line.title}: {', '.join(map(str, row.seeds))}"
        for row, line in zip(rows, compared, strict=True)
    )
    return [
        f"{scale.sentence()} Seeds: {seeds}.",
        table_i_block(compared, columns),
        *_comparison(alike, domain_label),
        f"{CURVES}\n\n![Learning curves]({_picture(CURVES_PICTURE, scale)})",
        f"Errors on the test images, for one training of each variant:\n\n"
        f"![Errors by depth, pitch, yaw and visibility]({_picture(ERRORS_PICTURE, scale)})",
    ]


def _comparison(alike: Sequence[TrainingRecord], domain_label: str) -> list[str]:
    """Errors of several trainings on the instruments that all detected, and the order."""
    if len(alike) == 1:
        return []
    common = common_instruments([record.found for record in alike])
    rows = rows_of([_with_errors_on(common, record) for record in alike])
    lines = [
        [
            variant_title(row.variant, domain_label, row.title),
            *report_tables.cells(row.metrics, COMMON_COLUMNS, row.spread),
        ]
        for row in rows
    ]
    headings = ["Variant", *(column.heading for column in COMMON_COLUMNS)]
    count = COMMON.format(count=len(common), total=alike[0].found.total)
    return [count, pipe_table(headings, lines), *_order(rows, domain_label)]


def _with_errors_on(instruments: set[int], record: TrainingRecord) -> TrainingRecord:
    """The record with its detection metrics and its errors on these instruments only."""
    finding = {name: record.row.metrics.get(name) for name in paper_order.DETECTION}
    metrics = finding | means_on(record.found, instruments)
    return replace(record, row=replace(record.row, metrics=metrics))


def _order(rows: Sequence[VariantRow], domain_label: str) -> list[str]:
    """The paper's order compared with rows of errors on the same instruments; empty unless a
    variant was repeated."""
    found = paper_order.changes(rows)
    if not found:
        return []
    titles = {row.variant: variant_title(row.variant, domain_label, row.title) for row in rows}
    lines = [
        [f"{titles[before]} to {titles[after]}"]
        + [_cell(metric, changes.get(metric)) for metric in paper_order.METRICS]
        for (before, after), changes in found.items()
    ]
    headings = ["Step", *(HEADINGS[metric] for metric in paper_order.METRICS)]
    return [ORDER, pipe_table(headings, lines)]


def _cell(metric: str, change: paper_order.Change | None) -> str:
    if change is None:
        return report_tables.MISSING
    return f"{change.difference:+.{DECIMALS[metric]}f} {change.verdict}"


def _picture(name: str, scale: Scale) -> str:
    return f"images/{name}_{scale.file_name()}.png"
