"""Writes the report of all variants from the results of earlier stages."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from shaftpose.core.files import new_file
from shaftpose.core.instruments import Annotations
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.split import read_keys
from shaftpose.evaluation.results import Evaluation
from shaftpose.figures.accuracy_figures import precision_recall_figure
from shaftpose.figures.binned_errors_figure import binned_error_figure
from shaftpose.figures.learning_curves_figure import learning_curve_figure
from shaftpose.figures.style import save_figure
from shaftpose.metrics.detection.average_precision import PrecisionRecall
from shaftpose.metrics.metrics import constant_predictor
from shaftpose.metrics.silhouette_iou import SilhouetteScore
from shaftpose.report.ablation import (
    FIT,
    AblationReport,
    Champion,
    MetricValues,
    VariantRow,
    choose_champion,
    variant_row,
    variant_title,
)
from shaftpose.report.ablation_figure import ablation_figure
from shaftpose.report.report import to_html, to_json, to_markdown
from shaftpose.stage_files import FITTED, read_domain, read_stage_file

logger = logging.getLogger(__name__)

# Logged values that the report draws.
LEARNING_CURVES = (
    *(f"{phase}/{term}" for phase in ("training", "validation")
      for term in ("confidence", "box", "pose")),
    "validation/mAP", "validation/detected_rate", "validation/tip_mm",
)  # fmt: skip

Evaluations = Mapping[str, Evaluation]  # by variant


def read_evaluations(folder: Path, variants: Sequence[str]) -> dict[str, Evaluation]:
    """The results of `evaluate`, by variant. Raises InputError naming a file that is missing."""
    remedy = "run `dvc repro evaluate`"
    return {
        name: read_stage_file(folder / name / "evaluation.json", Evaluation, remedy)
        for name in variants
    }


def with_fits(evaluations: Evaluations) -> dict[str, Evaluation]:
    """The evaluations, those of fitted poses behind those of their network, as `NAME+fit`."""
    rows = {}
    for name, one in evaluations.items():
        rows[name] = one
        if one.fitted:
            title = f"{one.title} + fit"
            rows[f"{name}{FIT}"] = replace(one, title=title, accuracy=one.fitted, fitted=None)
    return rows


def read_silhouettes(folder: Path, variants: Sequence[str]) -> dict[str, dict[str, MetricValues]]:
    """The results of `evaluate_real` by variant and set, those of fitted poses as in `with_fits`.

    Raises InputError naming a file that is missing.
    """
    rows: dict[str, dict[str, MetricValues]] = {}
    kind, remedy = dict[str, SilhouetteScore], "run `dvc repro evaluate_real`"
    for name in variants:
        scores = read_stage_file(folder / name / "silhouette.json", kind, remedy)
        for images, score in scores.items():
            fitted = images.startswith(FITTED)
            row = rows.setdefault(f"{name}{FIT}" if fitted else name, {})
            row[images.removeprefix(FITTED)] = asdict(score)
    return rows


def write_report(
    folder: Path, variants: Sequence[str], margin: float, profile: str, out: Path
) -> Champion:
    """Write `ablation.md`, `.json`, `.html` and `figures/` to `out`; returns the champion.

    folder: results of all variants; margin: see `choose_champion`.
    """
    evaluations, domain = read_evaluations(folder, variants), read_domain()
    rows = [variant_row(name, one) for name, one in with_fits(evaluations).items()]
    champion = choose_champion(
        {
            f"{name}{FIT}" if one.fitted else name: one.validation.as_dict()
            for name, one in evaluations.items()
        },
        margin,
    )
    shards = ShardedDataset(Path("data/render/images"))
    train, test = annotations(shards, "train"), annotations(shards, "test")
    constant = constant_predictor(train, test).as_dict()
    report = AblationReport(
        rows=rows,
        constant=constant,
        silhouette=read_silhouettes(folder, variants),
        domain_label=domain,
        champion=champion,
        profile=profile,
        figures=draw_figures(evaluations, rows, constant, domain, out),
    )
    for suffix, form in {"md": to_markdown, "json": to_json, "html": to_html}.items():
        with new_file(out / f"ablation.{suffix}") as part:
            part.write_text(form(report))
    logger.info("%s", to_markdown(report))
    logger.info("champion: %s (%s)", champion.variant, champion.rule)
    logger.info("report: %s", out / "ablation.html")
    return champion


def annotations(shards: ShardedDataset, part: str) -> list[Annotations]:
    """Annotations of the images in one part of the split."""
    keys = read_keys(Path("data/split"), part)
    return [shards.annotations(key) for key in tqdm(keys, f"reading {part} poses", unit="image")]


def draw_figures(
    evaluations: Evaluations,
    rows: list[VariantRow],
    constant: MetricValues,
    domain: str,
    out: Path,
) -> dict[str, Path]:
    """Draw the report's figures; returns title -> file."""
    trained, titled = titles(evaluations, domain), titles(with_fits(evaluations), domain)
    curves = {
        title: PrecisionRecall(
            **{name: np.array(values) for name, values in one.accuracy.precision_recall.items()}
        )
        for title, one in titled.items()
    }
    learning = {
        title: [[row for row in one.curves if row[1] in LEARNING_CURVES]]
        for title, one in trained.items()
    }
    bins = {title: one.accuracy.binned_errors for title, one in titled.items()}
    figures = {
        "Ablation": ablation_figure(rows, constant, domain),
        "Precision and recall": precision_recall_figure(curves),
        "Learning curves": learning_curve_figure(learning),
        "Binned errors": binned_error_figure(bins),
    }
    paths = {}
    for title, figure in figures.items():
        paths[title] = out / "figures" / f"{title.lower().replace(' ', '_')}.png"
        save_figure(figure, paths[title])
    return paths


def titles(evaluations: Evaluations, domain: str) -> dict[str, Evaluation]:
    """The evaluations by the titles of their variants."""
    return {variant_title(name, domain, one.title): one for name, one in evaluations.items()}
