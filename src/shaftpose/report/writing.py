"""Reads the results of all variants, and writes their report with its figures."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from shaftpose.core.files import new_file
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.split import read_keys
from shaftpose.evaluation.results import Accuracy, Evaluation, Silhouettes
from shaftpose.figures.accuracy_figures import precision_recall_figure
from shaftpose.figures.style import save_figure
from shaftpose.figures.variant_figures import binned_error_figure, learning_curve_figure
from shaftpose.metrics.detection.precision_recall import PrecisionRecall
from shaftpose.metrics.metrics import constant_predictor
from shaftpose.metrics.table import MetricValues
from shaftpose.report.ablation import AblationReport, VariantRow, variant_rows
from shaftpose.report.ablation_figure import ablation_figure
from shaftpose.report.dvc_tables import write_dvc_tables
from shaftpose.report.page import to_html, to_json, to_markdown
from shaftpose.stage_files import read_stage_file

logger = logging.getLogger(__name__)

# Logged values that the report draws.
LEARNING_CURVES = (
    *(f"{phase}/{term}" for phase in ("train", "validation")
      for term in ("confidence", "box", "pose")),
    "validation/mAP", "validation/detected_rate", "validation/tip_mm",
)  # fmt: skip


def read_evaluations(folder: Path, variants: Sequence[str]) -> dict[str, Evaluation]:
    """The results of `evaluate`, by variant. Raises InputError naming a file that is missing."""
    remedy = "run `dvc repro evaluate`"
    return {
        name: read_stage_file(folder / name / "evaluation.json", Evaluation, remedy)
        for name in variants
    }


def read_silhouettes(folder: Path, variants: Sequence[str]) -> dict[str, Silhouettes]:
    """The results of `evaluate_real`, by variant. Raises InputError naming a file that is
    missing."""
    remedy = "run `dvc repro evaluate_real`"
    return {
        name: read_stage_file(folder / name / "silhouette.json", Silhouettes, remedy)
        for name in variants
    }


def constant_metrics(images: Path, split: Path) -> MetricValues:
    """Metrics of the constant predictor on the test images."""
    shards = ShardedDataset(images)
    keys = {part: read_keys(split, part) for part in ("train", "test")}
    train, test = (
        [shards.annotations(key) for key in tqdm(found, f"reading {part} poses", disable=None)]
        for part, found in keys.items()
    )
    return constant_predictor(train, test)


def write_report(
    report: AblationReport,
    evaluations: Mapping[str, Evaluation],
    links: Mapping[str, str],
    results: Mapping[str, Path],
    out: Path,
) -> None:
    """Write `ablation.md`, `.json`, `.html`, `figures/` and the tables for DVC to `out`.

    links: variant -> address of its training in MLflow; results: variant -> folder of its
    evaluation.
    """
    write_dvc_tables(report, evaluations, out)
    figures = {}
    for title, figure in report_figures(report, evaluations).items():
        figures[title] = out / "figures" / f"{title.lower().replace(' ', '_')}.png"
        save_figure(figure, figures[title])
    titles = {row.variant: row.shown_title(report.domain_label) for row in report.rows}
    strips = {titles[name]: folder / "predictions.jpg" for name, folder in results.items()}
    runs = {titles[name]: link for name, link in links.items() if link}
    page = to_html(report, figures, strips, runs)
    texts = {"md": to_markdown(report), "json": to_json(report), "html": page}
    for suffix, text in texts.items():
        with new_file(out / f"ablation.{suffix}") as part:
            part.write_text(text)
    logger.info("%s", texts["md"])
    logger.info("report: %s", out / "ablation.html")


def report_figures(
    report: AblationReport, evaluations: Mapping[str, Evaluation]
) -> dict[str, Figure]:
    """The report's figures by title."""
    domain, learning, accuracies = report.domain_label, {}, dict[str, Accuracy]()
    for name, one in evaluations.items():
        titles = [row.shown_title(domain) for row in variant_rows(name, one)]
        curves = [row for row in one.curves if row[1] in LEARNING_CURVES]
        learning[titles[0]] = [curves]
        accuracies |= dict(zip(titles, one.by_kind.values(), strict=True))
    return {
        "Ablation": ablation_figure(report.rows, report.constant, domain),
        "Precision and recall": precision_recall_figure(
            {title: _curve(one) for title, one in accuracies.items()}
        ),
        "Learning curves": learning_curve_figure(learning),
        "Binned errors": binned_error_figure(
            {title: one.binned_errors for title, one in accuracies.items()}
        ),
    }


def _curve(accuracy: Accuracy) -> PrecisionRecall:
    return PrecisionRecall(
        **{name: np.array(values) for name, values in accuracy.precision_recall.items()}
    )


def all_rows(
    evaluations: Mapping[str, Evaluation], silhouettes: Mapping[str, Silhouettes]
) -> list[VariantRow]:
    """The rows of all variants, in their order."""
    return [
        row
        for name, one in evaluations.items()
        for row in variant_rows(name, one, silhouettes[name])
    ]
