"""The report's tables as text cells, for both Markdown and HTML."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass

from shaftpose.figures.binned_errors_figure import FEWEST
from shaftpose.metrics.binned_errors import ErrorBin
from shaftpose.metrics.bootstrap import Interval
from shaftpose.metrics.summary import Summary
from shaftpose.report import paper_numbers
from shaftpose.report.ablation import (
    AblationReport,
    MetricValues,
    VariantRow,
)
from shaftpose.stage_files import REAL, STAND_IN

MISSING = "n/a"
RENDERED = "rendered"


@dataclass(frozen=True)
class Column:
    """A metric: its name, its heading and the number of decimals."""

    name: str
    heading: str
    decimals: int


SCALE = (Column("training_images", "Training images", 0), Column("steps", "Steps", 0))
TABLE_I_METRICS = (
    Column("mAP", "mAP", 3),
    Column("detected_rate", "Detected rate", 3),
    Column("x_mm", "x [mm]", 2),
    Column("y_mm", "y [mm]", 2),
    Column("z_mm", "z [mm]", 2),
    Column("pitch_deg", "Pitch [deg]", 2),
    Column("yaw_deg", "Yaw [deg]", 2),
    Column("axis_deg", "Axis [deg]", 2),
    Column("tip_mm", "Tip [mm]", 2),
    Column("fps", "fps", 1),
)
TABLE_I_COLUMNS = SCALE + TABLE_I_METRICS
# Without the speed, which does not depend on how a network was trained.
TRAINING_COLUMNS = tuple(column for column in TABLE_I_COLUMNS if column.name != "fps")
TABLE_II_COLUMNS = (
    Column("clear/detected_rate", "Clear: detected rate", 3),
    Column("clear/iou", "Clear: IoU", 3),
    Column("occluded/detected_rate", "Occluded: detected rate", 3),
    Column("occluded/iou", "Occluded: IoU", 3),
)
IMAGE_COLUMNS = (
    Column("clear/tip_px", "Clear: tip [px]", 1),
    Column("clear/axis_deg", "Clear: axis [deg]", 1),
    Column("clear/axis_px", "Clear: axis [px]", 1),
    Column("occluded/tip_px", "Occluded: tip [px]", 1),
    Column("occluded/axis_deg", "Occluded: axis [deg]", 1),
    Column("occluded/axis_px", "Occluded: axis [px]", 1),
)
SPREAD_ERRORS = (("tip_mm", 2), ("axis_deg", 1), ("add_s_mm", 2), ("mssd_mm", 2), ("mspd_px", 1))
SPREAD_COLUMNS = (
    "Variant",
    "mAP",
    "Detected rate",
    "Detected rate at 0.5",
    "Tip [mm]",
    "Axis [deg]",
    "ADD-S [mm]",
    "MSSD [mm]",
    "MSPD [px]",
)
SPREAD = (
    "mAP and detected rate: 95 % confidence intervals (bootstrap over test images). Errors: "
    "median; 95th percentile (interval of the mean). ADD-S, and the BOP benchmark's "
    "MSSD and MSPD, are of the 10 mm of the shaft next to its tip."
)
IMAGE_ERRORS = (
    "Median errors of the detected instruments, in px and deg of the image of 299 x 299 px. Unlike "
    "poses in mm, they can be measured where camera and diameter are unknown."
)
DEPTHS = (
    "Median of estimated minus true depth (z) of the detected instruments in mm, by true depth, "
    f"for depths with at least {FEWEST} of them. "
    "Near shafts that are taken for farther ones make it positive, far ones that are taken for "
    "nearer ones negative."
)
SETUP_COLUMNS = (
    "Variant",
    "Training images",
    "Test images",
    "Steps",
    "Batch",
    "Width",
    "Depth",
    "Optimiser",
    "Detector steps",
    "Seeds",
    "Parameters",
    "Confidence",
)
ORIGIN_COLUMNS = ("Variant", "Command", "Commit", "Machine", "Data", "Training")
ORIGIN = (
    "Evaluations with the profile {profile}. Commit: of the code; + marks changed files. Machine: "
    "of the evaluation. Data: digests of the rendered images with their split, and of real or "
    "stand-in images mixed in. Training: its id in MLflow, which has its settings. Table II comes "
    "from the stage evaluate_real, with the same models. Seeds and numbers of images are in the "
    "table above."
)


@dataclass(frozen=True)
class ComparedRow:
    """A row of a table: the paper's cells (None if the paper has no such row) and ours.

    Table II adds both domains: a stand-in is never shown as the paper's domain.
    """

    title: str
    paper: list[str] | None
    ours: list[str]
    domain: str = ""
    paper_domain: str = ""
    champion: bool = False


@dataclass(frozen=True)
class Table:
    """A table with a title and a note, left out if it has no row."""

    title: str
    note: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]


def show(value: float | int | None, decimals: int) -> str:
    """A number with thousands separated, or "n/a" if it is missing or not finite."""
    if value is None or not math.isfinite(value):
        return MISSING
    return f"{value:,.{decimals}f}"


def table_i(report: AblationReport) -> list[ComparedRow]:
    """Every variant next to the paper's row, then the constant predictor."""
    rows = beside_paper(report.rows, report.domain_label, TABLE_I_COLUMNS, report.best)
    constant = ComparedRow("Constant predictor", None, cells(report.constant, TABLE_I_COLUMNS))
    return [*rows, constant]


def beside_paper(
    rows: Iterable[VariantRow],
    domain_label: str,
    columns: tuple[Column, ...],
    champion: VariantRow | None = None,
) -> list[ComparedRow]:
    """Variants next to the paper's rows, with `±` half the range if trained more than once."""
    return [
        ComparedRow(
            title=row.shown_title(domain_label),
            paper=None if row.refined else paper_cells(row.variant, columns),
            ours=cells(_measured(row), columns, row.spread),
            champion=row is champion,
        )
        for row in rows
    ]


def spread_table(report: AblationReport) -> Table:
    """Intervals, medians and 95th percentiles of each variant that has them."""
    rows = [
        [
            row.shown_title(report.domain_label),
            show_interval(row.summary.mAP, 3),
            show_interval(row.summary.detected_rate, 3),
            show(row.summary.detected_rate_at_half, 3),
            *(_error_cell(row.summary, name, decimals) for name, decimals in SPREAD_ERRORS),
        ]
        for row in report.rows
        if row.summary
    ]
    return Table("Intervals and spread of the errors", SPREAD, SPREAD_COLUMNS, rows)


def show_interval(ends: Interval | None, decimals: int) -> str:
    """An interval as text, such as "0.91 to 0.95"."""
    return MISSING if ends is None else f"{show(ends[0], decimals)} to {show(ends[1], decimals)}"


def _error_cell(summary: Summary, name: str, decimals: int) -> str:
    error = summary.errors.get(name)
    if error is None:
        return MISSING
    shown = (error.median, error.p95, *error.interval)
    return "{}; {} ({} to {})".format(*(show(value, decimals) for value in shown))


def depth_table(report: AblationReport) -> Table:
    """The bias of the depth of each variant that has it, by true depth."""
    bins = next((row.depths for row in report.rows if row.depths), ())
    headings = ["Variant", *(f"{one.low:g} to {one.high:g} mm" for one in bins)]
    rows = [[row.shown_title(report.domain_label), *map(_bias, row.depths)] for row in report.rows]
    known = [row for row in rows if set(row[1:]) - {MISSING}]
    return Table("Near and far", DEPTHS, headings, known)


def _bias(depth: ErrorBin) -> str:
    bias = depth.z_bias_mm if depth.count >= FEWEST else None
    return MISSING if bias is None else f"{bias:+.2f}"


def table_ii(report: AblationReport) -> list[ComparedRow]:
    """Rendered images, then real or stand-in images; one row for each measured variant."""
    # Our domain, its key in TABLE_II, and the paper's name for it.
    domains = ((RENDERED, RENDERED, "artificial"), (report.domain_label, REAL, REAL))
    return [
        ComparedRow(
            title=row.shown_title(report.domain_label),
            paper=_paper_silhouette_cells(row, paper_domain),
            ours=_with_intervals(_by_set(row.silhouettes, domain)),
            domain=domain,
            paper_domain=paper_word,
            champion=row is report.best,
        )
        for domain, paper_domain, paper_word in domains
        for row in report.rows
        if any(name.startswith(f"{domain}/") for name in row.silhouettes)
    ]


def image_table(report: AblationReport) -> Table:
    """Errors of tip and axis in the image, without variants for which they were not measured."""
    headings = ["Images", "Variant", *(column.heading for column in IMAGE_COLUMNS)]
    rows = [
        [
            domain,
            row.shown_title(report.domain_label),
            *cells(_by_set(row.silhouettes, domain), IMAGE_COLUMNS),
        ]
        for domain in (RENDERED, report.domain_label)
        for row in report.rows
    ]
    known = [row for row in rows if set(row[2:]) != {MISSING}]
    return Table("Tip and axis in the image", IMAGE_ERRORS, headings, known)


def _with_intervals(values: MetricValues) -> list[str]:
    """The cells of Table II, with the 95 % intervals of IoU where they were computed."""
    shown = cells(values, TABLE_II_COLUMNS)
    for n, column in enumerate(TABLE_II_COLUMNS):
        low, high = (values.get(f"{column.name}_{end}") for end in ("low", "high"))
        if low is not None and high is not None:
            shown[n] += f" ({show(low, 2)} to {show(high, 2)})"
    return shown


def setup_rows(report: AblationReport) -> list[list[str]]:
    """Training settings of each variant, cells in the order of `SETUP_COLUMNS`."""
    return [
        [
            row.shown_title(report.domain_label),
            *(show(n, 0) for n in (row.training_images, row.test_images, row.steps)),
            str(row.batch_size),
            *(MISSING if scale is None else f"{scale:g}" for scale in (row.width, row.depth)),
            row.optimizer.capitalize(),
            show(row.detector_steps or None, 0),
            ", ".join(str(seed) for seed in row.seeds),
            show(row.parameters, 0),
            show(row.metrics.get("confidence"), 2),
        ]
        for row in report.rows
    ]


def origin_table(report: AblationReport) -> Table:
    """How the numbers of each variant were made, if that is known."""
    rows = [
        [
            row.shown_title(report.domain_label),
            row.origin.command,
            row.origin.commit or MISSING,
            row.origin.machine,
            ", ".join(row.data),
            row.training_id,
        ]
        for row in report.rows
        if row.origin
    ]
    note = ORIGIN.format(profile=report.profile)
    return Table("How these numbers were made", note, ORIGIN_COLUMNS, rows)


def table_i_scale(report: AblationReport) -> list[str]:
    """Sentences on the scale of Table I, the paper's and ours."""
    rows = report.rows
    share = max((row.training_images for row in rows), default=0) / paper_numbers.TRAINING_IMAGES
    notes = [
        f"Paper: {paper_numbers.TRAINING_IMAGES:,} artificial training images (and "
        f"{paper_numbers.REAL_TRAINING_IMAGES} real ones in D + noise + real), "
        f"{paper_numbers.TEST_IMAGES:,} test images, batch {paper_numbers.BATCH_SIZE}; the number "
        "of steps is not stated. Its fps were measured on a Quadro GV100. Ours are a single "
        "reading with onnxruntime on a CPU, one image at a time, including decoding and, for E + "
        "fit, the fit; `make bench` measures the speed in repeated rounds.",
        f"Ours: {_span(r.training_images for r in rows)} training images (at most "
        f"{100 * share:.3g} % of the paper's), {_span(r.test_images for r in rows)} test images, "
        f"{_span(r.steps for r in rows)} steps, batch {_span(r.batch_size for r in rows)}, "
        f"backbone width {_span(r.width for r in rows)}, depth {_span(r.depth for r in rows)}.",
        "Errors are means over the detected instruments. The constant predictor returns the "
        "training set's mean box and pose for every image; its errors are means over all "
        "instruments.",
    ]
    notes += [_mixed_in(row, report.domain_label) for row in rows if row.mixed_in_images]
    if any(len(row.seeds) < 2 for row in rows):
        notes.append(
            "Variants with one seed were trained once, so this run does not show how large random "
            "differences are. docs/results.md lists repeated trainings."
        )
    return notes


def _mixed_in(row: VariantRow, domain_label: str) -> str:
    """Sentence on the number of real or stand-in images that a variant was trained on."""
    title = row.shown_title(domain_label)
    images = f"{row.mixed_in_images:,} {domain_label} images"
    sentence = f"{title}: {images} were mixed in with the rendered ones"
    paper = paper_numbers.TABLE_I.get(row.variant)
    if domain_label == STAND_IN and paper:
        sentence += f"; the paper's {paper.title} has real ones"
    return f"{sentence}."


def table_ii_scale(report: AblationReport) -> list[str]:
    """Sentences on the scale and the images of Table II."""
    scores = [score for row in report.rows for score in row.silhouettes.values()]
    images, instruments = (
        _span(count for score in scores if (count := score[name]) is not None)
        for name in ("images", "instruments")
    )
    notes = [
        f"Paper: {paper_numbers.SILHOUETTE_IMAGES} images in each cell. Ours: {images} images with "
        f"{instruments} instruments in each cell.",
        "IoU: union of the true visible masks against union of the silhouettes re-rendered at the "
        "estimated poses, per image, averaged over images; 0 if the network detects nothing. A "
        "silhouette counts even if its box is too inaccurate to count as detected. In brackets: "
        "95 % confidence interval (bootstrap over images). Silhouettes "
        "ignore occlusion: on occluded images, which hide a part of each shaft, no pose reaches 1.",
    ]
    if report.domain_label == STAND_IN:
        notes.append(
            f"No real image was measured: the {STAND_IN} images replace the "
            "paper's real images and are not evidence about real ones."
        )
    return notes


def _measured(row: VariantRow) -> dict[str, float | int | None]:
    return {**row.metrics, "training_images": row.training_images, "steps": row.steps}


def cells(
    values: MetricValues, columns: tuple[Column, ...], spread: MetricValues | None = None
) -> list[str]:
    """The formatted values of the columns, with `±` and the spread where there is one."""
    shown = [show(values.get(column.name), column.decimals) for column in columns]
    if not spread:
        return shown
    return [
        f"{cell} ± {show(spread[column.name], column.decimals)}" if column.name in spread else cell
        for cell, column in zip(shown, columns, strict=True)
    ]


def paper_cells(variant: str, columns: tuple[Column, ...]) -> list[str] | None:
    """The formatted values of the paper's row; None if it has no such row."""
    if variant not in paper_numbers.TABLE_I:
        return None
    values = asdict(paper_numbers.TABLE_I[variant])
    return cells({**values, "training_images": paper_numbers.TRAINING_IMAGES}, columns)


def _paper_silhouette_cells(row: VariantRow, domain: str) -> list[str] | None:
    pairs = {} if row.refined else paper_numbers.TABLE_II.get(row.variant, {})
    sets = {name: asdict(pair) for name, pair in pairs.items()}
    values = _by_set(sets, domain)
    return cells(values, TABLE_II_COLUMNS) if values else None


def _by_set(sets: Mapping[str, MetricValues], domain: str) -> dict[str, float | int | None]:
    """Values of one domain by `set/metric`, such as `clear/iou`."""
    return {
        f"{name.removeprefix(f'{domain}/')}/{metric}": value
        for name, score in sets.items()
        if name.startswith(f"{domain}/")
        for metric, value in score.items()
    }


def _span(values: Iterable[float | None]) -> str:
    """A single value or a range, such as "900 to 1,100"."""
    known = sorted({value for value in values if value is not None})
    if not known:
        return MISSING
    return " to ".join(_plain(value) for value in dict.fromkeys((known[0], known[-1])))


def _plain(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:g}"
