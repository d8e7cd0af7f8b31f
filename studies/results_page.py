"""The results page: the recorded run, repeated trainings, sweeps and benchmarks, from files."""

from collections.abc import Mapping, Sequence
from typing import Any

from shaftpose.figures.markdown import pipe_table
from shaftpose.figures.variant_figures import FEWEST
from shaftpose.report.ablation import AblationReport
from shaftpose.report.page import blocks
from shaftpose.settings.parsing import flatten
from shaftpose.sweeps.jobs import NO_VALUE
from studies.pages import rendered
from studies.record import EvaluatedTraining
from studies.table import difference_table, scale_tables

Table = list[list[str]]  # the headings, then the cells line by line


def to_page(
    report: AblationReport,
    records: Sequence[EvaluatedTraining],
    rounding: str,
    sweeps: Mapping[str, Table],
    benchmarks: Mapping[str, Any],
    whole_frames: Mapping[str, str],
    docs: str,
) -> str:
    """The page as Markdown, by the template results.md.j2.

    report: the recorded run; records: trainings, possibly repeated; rounding: table of the rounding
    errors of pose classes; sweeps: tables of sweeps, by name; benchmarks: contents of result files,
    by name; whole_frames: tables of `python -m studies.whole_frames`, by model; docs: the way to
    the documentation's folder, with a slash at its end, from a page that lies elsewhere.
    """
    return rendered(
        "results.md.j2",
        scales=scale_tables(records),
        differences=difference_table(records),
        rounding=rounding,
        profile=report.profile,
        run=blocks(report, "###"),
        fewest=FEWEST,
        sweeps={name: _sweep(*table) for name, table in sweeps.items()},
        no_value=NO_VALUE,
        whole_frames=whole_frames,
        benchmarks={name: _benchmark(content) for name, content in benchmarks.items()},
        docs=docs,
    )


def _sweep(headings: list[str], *jobs: list[str]) -> str:
    return pipe_table(headings, [[cell or NO_VALUE for cell in job] for job in jobs])


def _benchmark(content: Mapping[str, Any]) -> dict[str, Any]:
    """A table of the single values, and one of each list. `parts`, the details behind the values,
    stay in the file."""
    shown = flatten({key: value for key, value in content.items() if key != "parts"})
    single = [[key, _text(value)] for key, value in shown.items() if not _is_table(value)]
    tables = {key: _listed(rows) for key, rows in shown.items() if _is_table(rows)}
    return {"single": pipe_table(["key", "value"], single), "tables": tables}


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _listed(rows: Sequence[Mapping[str, Any]]) -> str:
    return pipe_table(list(rows[0]), [[_text(value) for value in row.values()] for row in rows])


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
