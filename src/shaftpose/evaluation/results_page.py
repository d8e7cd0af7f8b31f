"""The page of results: the recorded run, repeated trainings and benchmarks, all from files."""

from collections.abc import Mapping, Sequence
from typing import Any

from shaftpose.evaluation import report_tables
from shaftpose.evaluation.ablation import AblationReport, VariantRow
from shaftpose.evaluation.repeats import by_scale
from shaftpose.evaluation.report import blocks, pipe_table, table_i_block

INTRO = (
    "Written by `make results` from `reports/ablation.json`, `reports/trainings/*.json` and "
    "`benchmarks/results/*.json`; not to be edited."
)
BINNED = (
    "Errors of all variants by depth, pitch, yaw around the 0/358 seam and visible fraction; "
    "`make figures` takes the picture over from the recorded run.\n\n"
    "![Binned errors](images/binned_errors.png)"
)
REPEATED = (
    "Trainings outside the pipeline, and those of the recorded run at the same scale. Paper / ours;"
    " ours are means ± half the range over the seeds."
)


def to_page(
    report: AblationReport,
    profile: str,
    trainings: Sequence[VariantRow],
    benchmarks: Mapping[str, Any],
) -> str:
    """The page as Markdown.

    report: the recorded run, of the profile `profile`; trainings: single ones besides it;
    benchmarks: the contents of result files by name.
    """
    parts = ["# Results", INTRO, f"The recorded run has the profile `{profile}`."]
    parts += [*blocks(report), "## Where the errors are", BINNED]
    if trainings:
        parts += ["## Repeated trainings", REPEATED, *_repeated(report, trainings)]
    if benchmarks:
        parts += ["## Speed", *_speed(benchmarks)]
    return "\n\n".join(parts) + "\n"


def _repeated(report: AblationReport, trainings: Sequence[VariantRow]) -> list[str]:
    """A table for each scale of these trainings; the recorded run comes first in its own."""
    wanted = by_scale(trainings).keys()
    parts = []
    for key, rows in by_scale([*report.rows, *trainings]).items():
        if key in wanted:
            images, steps, batch_size, width = key
            seeds = ", ".join(
                f"{compared.title}: {', '.join(map(str, row.seeds))}"
                for row, compared in zip(rows, _compared(rows, report), strict=True)
            )
            parts += [
                f"{images:,} training images, {steps:,} steps of {batch_size}, width {width:g}. "
                f"Seeds: {seeds}.",
                table_i_block(_compared(rows, report)),
            ]
    return parts


def _compared(
    rows: Sequence[VariantRow], report: AblationReport
) -> list[report_tables.ComparedRow]:
    return report_tables.beside_paper(rows, report.domain_label)


def _speed(benchmarks: Mapping[str, Any]) -> list[str]:
    """For each benchmark its single values, then its lists as tables."""
    parts = []
    for name, content in benchmarks.items():
        single = [[key, _text(value)] for key, value in _flat(content) if not _is_table(value)]
        parts += [f"### {name}", pipe_table(["key", "value"], single)]
        for key, rows in _flat(content):
            if _is_table(rows):
                cells = [[_text(value) for value in row.values()] for row in rows]
                parts += [f"{key}:", pipe_table(list(rows[0]), cells)]
    return parts


def _flat(content: Mapping[str, Any], before: str = "") -> list[tuple[str, Any]]:
    """Keys and values of nested mappings, such as ("machine.cores", 2)."""
    found: list[tuple[str, Any]] = []
    for key, value in content.items():
        name = f"{before}{key}"
        found += _flat(value, f"{name}.") if isinstance(value, Mapping) else [(name, value)]
    return found


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
