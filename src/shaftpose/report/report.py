"""The ablation report as Markdown, JSON and one self-contained HTML file."""

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from importlib import resources
from pathlib import Path

from jinja2 import Environment, StrictUndefined

from shaftpose.core.errors import InputError
from shaftpose.figures.markdown import escape, pipe_table
from shaftpose.report import paper_numbers, report_tables
from shaftpose.report.ablation import AblationReport, MetricValues, VariantRow
from shaftpose.report.report_tables import MISSING, ComparedRow, show

HEADLINES = (
    report_tables.Column("mAP", "mAP", 3),
    report_tables.Column("detected_rate", "Detected rate", 3),
    report_tables.Column("tip_mm", "Tip error [mm]", 2),
    report_tables.Column("axis_deg", "Axis error [deg]", 2),
)


def to_markdown(report: AblationReport) -> str:
    """The report as Markdown, paper values first; figures are only in the HTML file."""
    return "\n\n".join(["# Ablation report", *blocks(report)]) + "\n"


def blocks(report: AblationReport, level: str = "##") -> list[str]:
    """The report's champion, tables and notes as Markdown, without the title; `level`: prefix of
    their headings."""
    headings_ii = ["Images", "Variant", *(c.heading for c in report_tables.TABLE_II_COLUMNS)]
    rows_ii = [[_domains(row), *_pair_cells(row)] for row in report_tables.table_ii(report)]
    return [
        f"Champion: **{escape(_champion(report))}**: {report.champion.rule}.",
        f"{level} Table I: accuracy on rendered test images (paper / ours)",
        "A single value is ours: the paper has no such row.",
        table_i_block(report_tables.table_i(report), report_tables.TABLE_I_COLUMNS),
        *report_tables.table_i_scale(report),
        *_optional(report_tables.spread_table(report), level),
        *_optional(report_tables.depth_table(report), level),
        f"{level} Table II: re-rendered silhouettes (paper / ours)",
        "A single value is ours: the paper has no such row.",
        pipe_table(headings_ii, rows_ii),
        *report_tables.table_ii_scale(report),
        *_optional(report_tables.image_table(report), level),
        f"{level} How each variant was trained",
        pipe_table(report_tables.SETUP_COLUMNS, report_tables.setup_rows(report)),
        *_optional(report_tables.origin_table(report), level),
    ]


def _optional(table: report_tables.Table, level: str) -> list[str]:
    """Title, note and table; nothing if it has no row."""
    if not table.rows:
        return []
    return [f"{level} {table.title}", table.note, pipe_table(table.headings, table.rows)]


def table_i_block(rows: list[ComparedRow], columns: tuple[report_tables.Column, ...]) -> str:
    """Rows of Table I with the given columns as Markdown, paper values first."""
    headings = ["Variant", *(column.heading for column in columns)]
    return pipe_table(headings, [_pair_cells(row) for row in rows])


def to_json(report: AblationReport) -> str:
    """The report's numbers and the paper's as JSON; missing and non-finite values are null."""
    content = {
        "champion": asdict(report.champion),
        "profile": report.profile,
        "domain_label": report.domain_label,
        "rows": [_json_row(row) for row in report.rows],
        "constant": _finite(report.constant),
        "paper_silhouette": {
            variant: {name: asdict(pair) for name, pair in sets.items()}
            for variant, sets in paper_numbers.TABLE_II.items()
        },
        "paper_scale": {
            "training_images": paper_numbers.TRAINING_IMAGES,
            "test_images": paper_numbers.TEST_IMAGES,
            "batch_size": paper_numbers.BATCH_SIZE,
        },
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def to_html(report: AblationReport, figures: Mapping[str, Path]) -> str:
    """The report as one self-contained file: no scripts, no links.

    figures: title -> PNG file, to be embedded.
    """
    template = resources.files("shaftpose.report").joinpath("report.html.j2").read_text("utf-8")
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(template).render(
        report=report,
        champion=_champion(report),
        headlines=_headlines(report),
        columns_i=report_tables.TABLE_I_COLUMNS,
        columns_ii=report_tables.TABLE_II_COLUMNS,
        setup_columns=report_tables.SETUP_COLUMNS,
        rows_i=report_tables.table_i(report),
        rows_ii=report_tables.table_ii(report),
        setup_rows=report_tables.setup_rows(report),
        notes_i=report_tables.table_i_scale(report),
        notes_ii=report_tables.table_ii_scale(report),
        spread=report_tables.spread_table(report),
        near_and_far=report_tables.depth_table(report),
        in_the_image=report_tables.image_table(report),
        origins=report_tables.origin_table(report),
        figures={title: _data_uri(path) for title, path in figures.items()},
        missing=MISSING,
    )


def _pair_cells(row: ComparedRow) -> list[str]:
    """The title, then "paper / ours" for each column; only ours if the paper has no row."""
    title = f"**{row.title}**" if row.champion else row.title
    if row.paper is None:
        return [title, *row.ours]
    return [title, *(f"{paper} / {ours}" for paper, ours in zip(row.paper, row.ours, strict=True))]


def _domains(row: ComparedRow) -> str:
    return row.domain if row.paper is None else f"{row.paper_domain} / {row.domain}"


def _json_row(row: VariantRow) -> dict[str, object]:
    paper = paper_numbers.TABLE_I.get(row.variant)
    return {
        **asdict(row),
        "metrics": _finite(row.metrics),
        "silhouettes": {name: _finite(score) for name, score in row.silhouettes.items()},
        "paper": asdict(paper) if paper else None,
    }


def _finite(values: MetricValues) -> dict[str, float | int | None]:
    return {
        name: value if value is not None and math.isfinite(value) else None
        for name, value in values.items()
    }


def _headlines(report: AblationReport) -> list[tuple[str, str]]:
    """The champion's figures of merit as (heading, value)."""
    metrics: MetricValues = report.best.metrics if report.best else {}
    return [(c.heading, show(metrics.get(c.name), c.decimals)) for c in HEADLINES]


def _champion(report: AblationReport) -> str:
    """The champion's title."""
    best = report.best
    return best.shown_title(report.domain_label) if best else report.champion.variant


def _data_uri(path: Path) -> str:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: the report's figure cannot be read: draw it first") from error
    return "data:image/png;base64," + base64.b64encode(content).decode("ascii")
