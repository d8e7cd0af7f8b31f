"""Stage `report`: all variants beside the paper's tables; the best one becomes champion."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
from results import read_json
from stage import Config, stage

from shaftpose import tracking
from shaftpose.dataset.split import read_keys
from shaftpose.evaluation.ablation import AblationReport, Champion, VariantRow, choose_champion
from shaftpose.evaluation.average_precision import PrecisionRecall
from shaftpose.evaluation.figures import (
    ablation_figure,
    learning_curve_figure,
    precision_recall_figure,
    save_figure,
)
from shaftpose.evaluation.metrics import constant_predictor
from shaftpose.evaluation.report import to_html, to_json, to_markdown
from shaftpose.instruments import Annotations
from shaftpose.shards import ShardedDataset

logger = logging.getLogger(__name__)

RESULTS = Path("data/results")


@stage
def main(config: Config) -> None:
    """Write `ablation.md`, `.json`, `.html` and `figures/` to `out`."""
    out, names = Path(config["out"]), config["variants"]
    results = {name: read_json(RESULTS / name / "evaluation.json", "evaluate") for name in names}
    rows = [variant_row(name, result) for name, result in results.items()]
    champion = choose_champion(rows, config["report"]["champion_margin"])
    domain = read_json(Path("data/real/about.json"), "real_images")["domain"]
    constant = constant_predictor(annotations("train"), annotations("test")).as_dict()
    report = AblationReport(
        rows=rows,
        constant=constant,
        silhouette={
            name: read_json(RESULTS / name / "silhouette.json", "evaluate_real") for name in names
        },
        domain_label=domain,
        champion=champion,
        figures=draw_figures(results, rows, constant, domain, out),
    )
    write_report(report, out)
    register(config, results, champion)
    logger.info("%s", to_markdown(report))
    logger.info("champion: %s (%s)", champion.variant, champion.rule)
    logger.info("report: %s", out / "ablation.html")


def variant_row(name: str, result: dict[str, Any]) -> VariantRow:
    """The table line of one variant."""
    training, metrics = result["training"], result["metrics"]
    return VariantRow(
        variant=name,
        title=result["title"],
        metrics=metrics,
        training_images=training["training_images"],
        test_images=metrics["images"],
        steps=training["steps"],
        batch_size=training["batch_size"],
        width=training["width"],
        seeds=(training["seed"],),
        parameters=training["parameters"],
    )


def annotations(part: str) -> list[Annotations]:
    """What is in the images of one part of the split."""
    shards = ShardedDataset(Path("data/render/images"))
    return [shards.annotations(key) for key in read_keys(Path("data/split"), part)]


def draw_figures(
    results: dict[str, Any],
    rows: list[VariantRow],
    constant: dict[str, Any],
    domain: str,
    out: Path,
) -> dict[str, Path]:
    """The report's figures: title -> file."""
    curves = {
        result["title"]: PrecisionRecall(
            **{name: np.array(values) for name, values in result["precision_recall"].items()}
        )
        for result in results.values()
    }
    learning = {
        result["title"]: [tuple(row) for row in result["curves"]] for result in results.values()
    }
    figures = {
        "Ablation": ablation_figure(rows, constant, domain),
        "Precision and recall": precision_recall_figure(curves),
        "Learning curves": learning_curve_figure(learning),
    }
    paths = {}
    for title, figure in figures.items():
        paths[title] = out / "figures" / f"{title.lower().replace(' ', '_')}.png"
        save_figure(figure, paths[title])
    return paths


def write_report(report: AblationReport, out: Path) -> None:
    """The three forms of the report."""
    (out / "ablation.md").write_text(to_markdown(report))
    (out / "ablation.json").write_text(to_json(report))
    (out / "ablation.html").write_text(to_html(report))


def register(config: Config, results: dict[str, Any], champion: Champion) -> None:
    """Register the champion's model with MLflow."""
    tracking.connect(**config["tracking"])
    training_id = results[champion.variant]["training"]["training_id"]
    tracking.register_champion(training_id, champion.variant, champion.rule)


if __name__ == "__main__":
    main()
