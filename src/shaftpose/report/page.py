"""The ablation report as Markdown, as one HTML file made from it, and as JSON."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from markdown_it import MarkdownIt

from shaftpose.figures.html_pages import data_uri, html_template
from shaftpose.figures.markdown import escape, pipe_table
from shaftpose.metrics.table import MetricValues, metrics_named
from shaftpose.report import accuracy_tables, paper_numbers, silhouette_tables, training_tables
from shaftpose.report.ablation import AblationReport, VariantRow
from shaftpose.report.cells import cells

TITLE = "Ablation report"
MERITS = metrics_named("mAP", "detected_rate", "tip_mm", "axis_deg")
PAIRS = "A single value is ours: the paper has no such row."


@dataclass(frozen=True)
class Section:
    """A part of the report; title: plain text; text: Markdown."""

    title: str
    text: str


def sections(report: AblationReport) -> list[Section]:
    """The report: its champion, tables and notes."""
    spread, depths = accuracy_tables.spread_table(report), accuracy_tables.depth_table(report)
    image, origins = silhouette_tables.image_table(report), training_tables.origin_table(report)
    differences = training_tables.difference_table(report)
    made = training_tables.ORIGINS.format(profile=escape(report.profile))
    return [
        Section("Champion", _champion(report)),
        *_optional("What differs", training_tables.DIFFERENCES, differences),
        Section(
            "Table I: accuracy on rendered test images (paper / ours)",
            _text(
                PAIRS, accuracy_tables.table_i(report), *accuracy_tables.notes_on_table_i(report)
            ),
        ),
        *_optional("Intervals and spread of the errors", accuracy_tables.SPREAD, spread),
        *_optional("Near and far", accuracy_tables.DEPTHS, depths),
        Section(
            "Table II: re-rendered silhouettes (paper / ours)",
            _text(
                PAIRS,
                silhouette_tables.table_ii(report.rows, report.domain_label, report.best),
                *silhouette_tables.notes_on_table_ii(report),
            ),
        ),
        *_optional("Tip and axis in the image", silhouette_tables.IMAGE_ERRORS, image),
        Section("How each variant was trained", training_tables.setup_table(report)),
        *_optional("How these numbers were made", made, origins),
    ]


def _champion(report: AblationReport) -> str:
    """The champion's title, why it was chosen, and its figures of merit."""
    best, rule = report.best, escape(report.champion.rule)
    if best is None:
        return f"**{escape(report.champion.variant)}**: {rule}."
    merits = pipe_table([one.label for one in MERITS], [cells(best.metrics, MERITS)])
    return _text(f"{best.title_cell(report.domain_label, best=True)}: {rule}.", merits)


def _text(*blocks: str) -> str:
    return "\n\n".join(blocks)


def _optional(title: str, note: str, table: str | None) -> list[Section]:
    return [Section(title, _text(note, table))] if table else []


def to_markdown(report: AblationReport) -> str:
    """The report as Markdown; figures are only in the HTML file."""
    return f"# {TITLE}\n\n{blocks(report)}\n"


def blocks(report: AblationReport, level: str = "##") -> str:
    """The report without its title; level: prefix of its headings."""
    return _text(*(f"{level} {escape(one.title)}\n\n{one.text}" for one in sections(report)))


def to_html(
    report: AblationReport,
    figures: Mapping[str, Path],
    strips: Mapping[str, Path],
    links: Mapping[str, str],
) -> str:
    """The report as one self-contained file without scripts.

    figures: title -> picture, to be embedded; strips: the same, of each variant's predictions on
    the same images; links: title -> address of a training in MLflow.
    """
    renderer = MarkdownIt("commonmark", {"html": False}).enable("table")
    return html_template("shaftpose.report", "report.html.j2").render(
        title=TITLE,
        sections=[(one.title, renderer.render(one.text)) for one in sections(report)],
        figures={title: data_uri(path) for title, path in figures.items()},
        strips={title: data_uri(path) for title, path in strips.items()},
        links=links,
    )


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


def _json_row(row: VariantRow) -> dict[str, object]:
    return {
        **asdict(row),
        "metrics": _finite(row.metrics),
        "silhouettes": {name: _finite(score) for name, score in row.silhouettes.items()},
        "paper": asdict(row.paper) if row.paper else None,
    }


def _finite(values: MetricValues) -> dict[str, float | int | None]:
    return {
        name: value if value is not None and math.isfinite(value) else None
        for name, value in values.items()
    }
