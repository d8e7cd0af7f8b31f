"""Writes the report of all variants from the results of earlier stages."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from shaftpose.core.figure_style import save_figure
from shaftpose.core.instruments import Annotations
from shaftpose.core.shards import ShardedDataset
from shaftpose.core.split_lists import read_keys
from shaftpose.evaluation.average_precision import PrecisionRecall
from shaftpose.evaluation.binned_errors import from_plain
from shaftpose.evaluation.metrics import constant_predictor
from shaftpose.figures.accuracy_figures import precision_recall_figure
from shaftpose.figures.binned_errors_figure import binned_error_figure
from shaftpose.figures.learning_curves_figure import learning_curve_figure
from shaftpose.files import new_file
from shaftpose.json_files import read_domain, read_result
from shaftpose.report.ablation import (
    FIT,
    AblationReport,
    Champion,
    VariantRow,
    choose_champion,
    variant_row,
    variant_title,
)
from shaftpose.report.ablation_figure import ablation_figure
from shaftpose.report.report import to_html, to_json, to_markdown

logger = logging.getLogger(__name__)

# Logged values that the report draws.
LEARNING_CURVES = (
    *(f"{phase}/{term}" for phase in ("training", "validation")
      for term in ("confidence", "box", "pose")),
    "validation/mAP", "validation/detected_rate", "validation/tip_mm",
)  # fmt: skip

FITTED = "fitted/"  # prefix of the image sets on which fitted poses were measured

Results = Mapping[str, dict[str, Any]]  # variant -> results of `evaluate`


def read_results(folder: Path, variants: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The results of `evaluate`, by variant. Raises InputError naming a file that is missing."""
    return {name: read_result(folder / name / "evaluation.json", "evaluate") for name in variants}


def with_fits(results: Results) -> dict[str, dict[str, Any]]:
    """The results, those of fitted poses behind those of their network, as `NAME_fitted`."""
    rows = {}
    for name, result in results.items():
        rows[name] = result
        if result["fitted"]:
            title = f"{result['title']} + fit"
            rows[f"{name}{FIT}"] = result | result["fitted"] | {"title": title}
    return rows


def read_silhouettes(
    folder: Path, variants: Sequence[str]
) -> dict[str, dict[str, dict[str, float | None]]]:
    """The results of `evaluate_real` by variant and set, those of fitted poses as in `with_fits`.

    Raises InputError naming a file that is missing.
    """
    rows: dict[str, dict[str, dict[str, float | None]]] = {}
    for name in variants:
        scores = read_result(folder / name / "silhouette.json", "evaluate_real")
        for images, score in scores.items():
            fitted = images.startswith(FITTED)
            row = rows.setdefault(f"{name}{FIT}" if fitted else name, {})
            row[images.removeprefix(FITTED)] = score
    return rows


def write_report(
    folder: Path, variants: Sequence[str], margin: float, profile: str, out: Path
) -> Champion:
    """Write `ablation.md`, `.json`, `.html` and `figures/` to `out`; returns the champion.

    folder: results of all variants; margin: see `choose_champion`.
    """
    results, domain = read_results(folder, variants), read_domain()
    rows = [variant_row(name, result) for name, result in with_fits(results).items()]
    champion = choose_champion(
        {
            f"{name}{FIT}" if result["fitted"] else name: result["validation"]
            for name, result in results.items()
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
        figures=draw_figures(results, rows, constant, domain, out),
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
    results: Results,
    rows: list[VariantRow],
    constant: dict[str, Any],
    domain: str,
    out: Path,
) -> dict[str, Path]:
    """Draw the report's figures; returns title -> file."""
    trained, titled = titles(results, domain), titles(with_fits(results), domain)
    curves = {
        title: PrecisionRecall(
            **{name: np.array(values) for name, values in result["precision_recall"].items()}
        )
        for title, result in titled.items()
    }
    learning = {
        title: [[tuple(row) for row in result["curves"] if row[1] in LEARNING_CURVES]]
        for title, result in trained.items()
    }
    bins = {title: from_plain(result["binned_errors"]) for title, result in titled.items()}
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


def titles(results: Results, domain: str) -> dict[str, dict[str, Any]]:
    """The results by the titles of their variants."""
    return {variant_title(name, domain, one["title"]): one for name, one in results.items()}
