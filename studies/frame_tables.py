"""Tables of models on whole real frames, from the files of `studies.real_frames`."""

from collections.abc import Sequence
from pathlib import Path

from shaftpose.evaluation.frame_results import ALL, FrameResults
from shaftpose.evaluation.true_shafts import GROUPS
from shaftpose.figures.markdown import pipe_table
from shaftpose.metrics.frames.measures import Estimate, FrameMetrics
from shaftpose.metrics.table import Metric, metrics_named
from shaftpose.report.cells import headings, show, show_interval
from shaftpose.stage_files import read_stage_file
from studies.real_frames import GALLERY, RECORDS, TEST, TISSUE, VALIDATION, Runs, label, runs_of

BOXES = metrics_named("box_ap50", "mask_ap50", "box_recall", "box_precision")
AXES = metrics_named("axis_recall", "axis_precision", "axis_recall_at_precision")
MASKS = metrics_named("pq", "shaft_iou", "image_iou")
TOOLS = metrics_named("tool_iou")
_NOTHING = "No model was measured yet. `python -m studies.real_frames` measures one."
_EMPTY = "empty_detected"
_TISSUE = "Squares of tissue, without a tool"
_GALLERY = (
    "![Worst frames](../{path})\n\n*The frames with the most missed and false shafts: annotated "
    "outlines green, found ones yellow. The captions name model, file and part. Frames: "
    "egoodman92/laparoscopic-dataset (MIT) and Roboflow user works-ly0n7, surgical-segmentation "
    "v3 (CC BY 4.0), made smaller and drawn over.*"
)


def frame_blocks(root: Path) -> str:
    """How often the test part was run, the tables of both parts, and the gallery below `root`."""
    records = root / RECORDS
    parts = (TEST, "The test part"), (VALIDATION, "The validation part"), (TISSUE, _TISSUE)
    results = [(part, title, results_of(records, part)) for part, title in parts]
    tables = [
        f"**{title}**\n\n{_tissue_table(found) if part == TISSUE else part_tables(found)}"
        for part, title, found in results
        if found
    ]
    if not tables:
        return _NOTHING
    drawn = [_GALLERY.format(path=RECORDS / GALLERY)] if (records / GALLERY).is_file() else []
    groups = "; ".join(f"{name}: {meaning}" for name, meaning in GROUPS.items())
    intervals = "In brackets: 95 % intervals (bootstrap over operations)."
    notes = f"Groups of shafts: {groups}. {intervals}"
    return "\n\n".join([runs_sentence(runs_of(records)), *tables, notes, *drawn])


def results_of(records: Path, part: str) -> list[FrameResults]:
    """The results of all models on a part, by the names of their files."""
    return [
        read_stage_file(path, FrameResults, "restore it from git")
        for path in sorted(records.glob(f"*-{part}.json"))
    ]


def runs_sentence(runs: Runs) -> str:
    """How often the test part was run, and with which models."""
    listed = (f"{label(run.model, run.sha256)} on {run.date}" for run in runs.test)
    stated = f": {', '.join(listed)}" if runs.test else ""
    times = "once" if len(runs.test) == 1 else f"{len(runs.test)} times"
    return f"The test part was run {times}{stated}."


def part_tables(results: Sequence[FrameResults]) -> str:
    """Tables of boxes, axes and masks by group, and one of tools, one row for each model."""
    tables = [_table(results, metrics, ("shafts",)) for metrics in (BOXES, AXES)]
    tables.append(_table(results, MASKS, ("shafts", "missed", "false")))
    scenes = [[*_scene(one), *_cells(one.groups[ALL], TOOLS)] for one in results]
    tables.append(pipe_table(["Model", "Frames", "Operations", *headings(TOOLS)], scenes))
    return "\n\n".join(tables)


def _tissue_table(results: Sequence[FrameResults]) -> str:
    """A table of images without a tool: a number, as the bootstrap has no interval for none."""
    rows = [[*_scene(one), show(_detected(one.groups[ALL]), 0)] for one in results]
    return pipe_table(["Model", "Squares", "Operations", "With a detection"], rows)


def _detected(every: FrameMetrics) -> int | None:
    share = every.metrics[_EMPTY].value
    return None if share is None else round(share * every.counts.frames)


def _scene(one: FrameResults) -> list[str]:
    counts = one.groups[ALL].counts
    return [_model(one), show(counts.frames, 0), show(counts.operations, 0)]


def _table(
    results: Sequence[FrameResults], metrics: Sequence[Metric], counts: Sequence[str]
) -> str:
    """Metrics and numbers of each model by group, with the mean hidden share of its shafts."""
    rows = [
        [
            _model(one),
            name,
            show(group.hidden_share, 3),
            *(show(getattr(group.counts, count), 0) for count in counts),
            *_cells(group, metrics),
        ]
        for one in results
        for name, group in one.groups.items()
    ]
    columns = ["Model", "Shafts", "Hidden", *(_HEADINGS[count] for count in counts)]
    return pipe_table([*columns, *headings(metrics)], rows)


_HEADINGS = {"shafts": "Number", "missed": "Missed", "false": "False"}


def _model(results: FrameResults) -> str:
    return label(results.model, results.sha256)


def _cells(group: FrameMetrics, metrics: Sequence[Metric]) -> list[str]:
    """Values of metrics with their intervals."""
    return [_cell(group.metrics[metric.name], metric.digits) for metric in metrics]


def _cell(estimate: Estimate, digits: int) -> str:
    if estimate.low is None or estimate.high is None:
        return show(estimate.value, digits)
    interval = show_interval((estimate.low, estimate.high), 2)
    return f"{show(estimate.value, digits)} ({interval})"
