"""Scores of silhouettes and errors in the image, as Markdown: Table II and tip and axis."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from shaftpose.evaluation.results import OCCLUSIONS
from shaftpose.figures.markdown import pipe_table
from shaftpose.metrics.table import Metric, MetricValues, metrics_named, metrics_of
from shaftpose.report import paper_numbers
from shaftpose.report.ablation import AblationReport, VariantRow
from shaftpose.report.cells import MISSING, cells, paired, show, show_span
from shaftpose.stage_files import REAL, STAND_IN

RENDERED = "rendered"
TABLE_II, IMAGE = metrics_named("detected_rate", "iou"), metrics_of("image")
IMAGE_ERRORS = (
    "Median errors of the detected instruments, in px and deg of the image of 299 x 299 px. Unlike "
    "poses in mm, they can be measured where camera and diameter are unknown."
)


def table_ii(rows: Sequence[VariantRow], domain_label: str, best: VariantRow | None = None) -> str:
    """Rendered images, then real or stand-in images: "paper / ours" of each measured row.

    Both domains are named: a stand-in is never shown as the paper's real images. best: the row
    whose title is bold.
    """
    # Our domain, its key in the paper's Table II, and the paper's name for it.
    domains = ((RENDERED, RENDERED, "artificial"), (domain_label, REAL, REAL))
    lines = []
    for domain, paper_domain, paper_word in domains:
        for row in rows:
            if ours := _by_occlusion(row.silhouettes, domain):
                paper = _paper_cells(row, paper_domain)
                images = domain if paper is None else f"{paper_word} / {domain}"
                title = row.title_cell(domain_label, row is best)
                lines.append([images, title, *paired(paper, _with_intervals(ours))])
    return pipe_table(["Images", "Variant", *_headings(TABLE_II)], lines)


def _headings(metrics: Sequence[Metric]) -> list[str]:
    """`Clear: IoU` and so on."""
    return [
        f"{occlusion.capitalize()}: {one.heading}" for occlusion in OCCLUSIONS for one in metrics
    ]


def _by_occlusion(sets: Mapping[str, MetricValues], domain: str) -> list[MetricValues]:
    """The scores of one domain's clear and occluded images; nothing if it was not measured."""
    names = [f"{domain}/{occlusion}" for occlusion in OCCLUSIONS]
    return [sets.get(name, {}) for name in names] if any(n in sets for n in names) else []


def _paper_cells(row: VariantRow, domain: str) -> list[str] | None:
    pairs = paper_numbers.TABLE_II.get(row.variant, {}) if row.paper else {}
    known = _by_occlusion({name: asdict(pair) for name, pair in pairs.items()}, domain)
    return [cell for values in known for cell in cells(values, TABLE_II)] or None


def _with_intervals(scores: Sequence[MetricValues]) -> list[str]:
    """The cells of Table II, with the 95 % intervals of IoU where they were computed."""
    shown = []
    for values in scores:
        rate, iou = cells(values, TABLE_II)
        low, high = values.get("iou_low"), values.get("iou_high")
        known = low is not None and high is not None
        shown += [rate, f"{iou} ({show(low, 2)} to {show(high, 2)})" if known else iou]
    return shown


def notes_on_table_ii(report: AblationReport) -> list[str]:
    """Sentences on the scale and the images of Table II."""
    scores = [score for row in report.rows for score in row.silhouettes.values()]
    images, instruments = (
        show_span(score.get(name) for score in scores) for name in ("images", "instruments")
    )
    notes = [
        f"Paper: {paper_numbers.SILHOUETTE_IMAGES} images in each cell. Ours: {images} images with "
        f"{instruments} instruments in each cell.",
        "IoU: union of the true visible masks against union of the silhouettes re-rendered at the "
        "estimated poses, per image, averaged over images; 0 if the network detects nothing. A "
        "silhouette counts even if its box is too inaccurate to count as detected. In brackets: "
        "95 % confidence interval (bootstrap over images). Silhouettes "
        "ignore occlusion: on occluded images, which hide a part of each shaft, no pose reaches 1.",
        "Detected: true boxes, and those that networks learn, enclose what is visible; boxes of "
        "fitted poses enclose the whole shaft, so that an occluded one may count as not detected.",
    ]
    if report.domain_label == STAND_IN:
        notes.append(
            f"No real image was measured: the {STAND_IN} images replace the "
            "paper's real images and are not evidence about real ones."
        )
    return notes


def image_table(report: AblationReport) -> str | None:
    """Errors of tip and axis in the image of each row that has them; None without any."""
    rows = [
        [domain, row.title_cell(report.domain_label), *_image_cells(row.silhouettes, domain)]
        for domain in (RENDERED, report.domain_label)
        for row in report.rows
    ]
    known = [row for row in rows if set(row[2:]) - {MISSING}]
    return pipe_table(["Images", "Variant", *_headings(IMAGE)], known) if known else None


def _image_cells(sets: Mapping[str, MetricValues], domain: str) -> list[str]:
    return [cell for values in _by_occlusion(sets, domain) for cell in cells(values, IMAGE)]
