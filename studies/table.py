"""Repeated trainings on the results page: tables, verdicts and pictures of each scale."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from matplotlib.figure import Figure

from shaftpose.figures.markdown import pipe_table
from shaftpose.figures.variant_figures import binned_error_figure, learning_curve_figure
from shaftpose.metrics.pose_errors import common_instruments, means_on
from shaftpose.metrics.table import Metric, metrics_of
from shaftpose.report.ablation import VariantRow
from shaftpose.report.accuracy_tables import ACCURACY, rows_beside_paper
from shaftpose.report.cells import MISSING, cells, headings
from shaftpose.report.silhouette_tables import table_ii
from shaftpose.stage_files import REAL, STAND_IN
from studies import paper_order
from studies.aggregate import Scale, by_scale, distinctions, rows_of
from studies.record import EvaluatedTraining

POSE = metrics_of("pose")
# Prefixes of picture names.
CURVES_PICTURE, ERRORS_PICTURE = "curves", "errors"
PICTURES = (CURVES_PICTURE, ERRORS_PICTURE)


@dataclass(frozen=True)
class CommonErrors:
    """Tables of several trainings on the `count` of `total` instruments that all detected: errors,
    and the paper's order, "" unless a variant was repeated."""

    count: int
    total: int
    table: str
    order: str


@dataclass(frozen=True)
class ScaleTables:
    """Trainings of one scale: a heading, a sentence on their settings, their seeds, accuracy,
    common errors, silhouettes ("" if they were not measured), and paths of two pictures, "" unless
    several trainings are compared."""

    heading: str
    sentence: str
    seeds: str
    table: str
    common: CommonErrors | None
    silhouettes: str
    curves: str
    errors: str


def scale_tables(records: Sequence[EvaluatedTraining]) -> list[ScaleTables]:
    """The tables of each scale of these trainings."""
    scales = by_scale(records)
    return [
        _of_scale(heading, scale, scales[scale]) for scale, heading in _headings(scales).items()
    ]


def difference_table(records: Sequence[EvaluatedTraining]) -> str:
    """The settings in which the scales of these trainings differ; empty for a single scale."""
    scales = by_scale(records)
    if not (differing := distinctions(list(scales))):
        return ""
    lines = [[name, *map(str, values)] for name, values in differing.items()]
    return pipe_table(["Setting", *_headings(scales).values()], lines)


def _headings(scales: Mapping[Scale, Sequence[EvaluatedTraining]]) -> dict[Scale, str]:
    """The heading of each scale; of those with equal ones, all but the first also say in which
    settings they differ from the first."""
    first, found = dict[str, Scale](), dict[Scale, str]()
    for scale, alike in scales.items():
        turned = ", symmetries" if all(one.variant.get("symmetries") for one in alike) else ""
        heading = f"{scale.training_images:,} images, {scale.steps:,} steps{turned}"
        differing = distinctions([first.setdefault(heading, scale), scale])
        settings = [f"{name} {own}" for name, (_, own) in differing.items()]
        found[scale] = ", ".join([heading, *settings])
    return found


def repeated_figures(records: Sequence[EvaluatedTraining]) -> dict[str, Figure]:
    """Learning curves of all trainings of a scale that has several, and binned errors of one of
    each variant, by path relative to the page."""
    found = {}
    for scale, alike in by_scale(records).items():
        if not _are_several(alike):
            continue
        by_title: dict[str, list[EvaluatedTraining]] = {}
        for record in alike:
            title = record.row.shown_title(_domain_of(alike))
            by_title.setdefault(title, []).append(record)
        found[_picture(CURVES_PICTURE, scale)] = learning_curve_figure(
            {
                title: [one.curves for one in repeats]
                for title, repeats in by_title.items()
                if any(one.curves for one in repeats)
            }
        )
        found[_picture(ERRORS_PICTURE, scale)] = binned_error_figure({
            f"{title}, seed {first.row.seeds[0]}": first.binned_errors
            for title, (first, *_) in by_title.items()
        })  # fmt: skip
    return found


def _are_several(alike: Sequence[EvaluatedTraining]) -> bool:
    """Whether records are of more than one training, which may have some of refined poses."""
    return len({(one.row.variant, one.row.seeds) for one in alike}) > 1


def _domain_of(alike: Sequence[EvaluatedTraining]) -> str:
    """The domain of the images without poses that were mixed in or measured."""
    mixed_in = {record.mixed_in.domain for record in alike if record.mixed_in}
    measured = {images.partition("/")[0] for one in alike for images in one.row.silhouettes}
    return REAL if REAL in mixed_in | measured else STAND_IN


def _of_scale(heading: str, scale: Scale, alike: Sequence[EvaluatedTraining]) -> ScaleTables:
    rows, domain_label = rows_of(alike), _domain_of(alike)
    seeds = "; ".join(
        f"{row.title_cell(domain_label)}: {', '.join(map(str, row.seeds))}" for row in rows
    )
    curves, errors = (_picture(name, scale) if _are_several(alike) else "" for name in PICTURES)
    return ScaleTables(
        heading=heading,
        sentence=scale.sentence(),
        seeds=seeds,
        table=rows_beside_paper(rows, domain_label, ACCURACY),
        common=_common_errors(alike, domain_label) if len(alike) > 1 else None,
        silhouettes=table_ii(rows, domain_label) if any(row.silhouettes for row in rows) else "",
        curves=curves,
        errors=errors,
    )


def _common_errors(alike: Sequence[EvaluatedTraining], domain_label: str) -> CommonErrors:
    common = common_instruments([record.found for record in alike])
    rows = rows_of([_with_errors_on(common, record) for record in alike])
    lines = [[row.title_cell(domain_label), *cells(row.metrics, POSE, row.spread)] for row in rows]
    table = pipe_table(["Variant", *headings(POSE)], lines)
    return CommonErrors(len(common), alike[0].found.total, table, _order(rows, domain_label))


def _with_errors_on(instruments: set[int], record: EvaluatedTraining) -> EvaluatedTraining:
    """The record with its detection metrics and its errors on these instruments only."""
    finding = {one.name: record.row.metrics.get(one.name) for one in metrics_of("detection")}
    metrics = finding | means_on(record.found, instruments)
    return replace(record, row=replace(record.row, metrics=metrics))


def _order(rows: Sequence[VariantRow], domain_label: str) -> str:
    """The paper's order compared with rows of errors on the same instruments."""
    found = paper_order.changes(rows)
    if not found:
        return ""
    titles = {row.variant: row.title_cell(domain_label) for row in rows if not row.refined}
    lines = [
        [f"{titles[before]} to {titles[after]}"]
        + [_cell(metric, changes.get(metric.name)) for metric in paper_order.PAPER_METRICS]
        for (before, after), changes in found.items()
    ]
    return pipe_table(["Step", *headings(paper_order.PAPER_METRICS)], lines)


def _cell(metric: Metric, change: paper_order.Change | None) -> str:
    if change is None:
        return MISSING
    return f"{change.difference:+.{metric.digits}f} {change.verdict}"


def _picture(name: str, scale: Scale) -> str:
    return f"images/{name}_{scale.file_name()}.png"
