"""Stage `report`: all variants beside the paper's tables; the best one becomes champion."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
from results import read_domain, read_result
from stage import Config, stage
from tqdm import tqdm

from shaftpose import tracking
from shaftpose.dataset.split import read_keys
from shaftpose.evaluation.ablation import (
    AblationReport,
    Champion,
    VariantRow,
    choose_champion,
    variant_row,
    variant_title,
)
from shaftpose.evaluation.ablation_figure import ablation_figure
from shaftpose.evaluation.accuracy_figures import precision_recall_figure
from shaftpose.evaluation.average_precision import PrecisionRecall
from shaftpose.evaluation.binned_errors import from_plain
from shaftpose.evaluation.binned_errors_figure import binned_error_figure
from shaftpose.evaluation.figure_style import save_figure
from shaftpose.evaluation.learning_curves_figure import learning_curve_figure
from shaftpose.evaluation.metrics import constant_predictor
from shaftpose.evaluation.report import to_html, to_json, to_markdown
from shaftpose.evaluation.training_record import last_validation
from shaftpose.files import new_file
from shaftpose.instruments import Annotations
from shaftpose.shards import ShardedDataset

logger = logging.getLogger(__name__)

RESULTS = Path("data/results")
# Of all that trainings log, what the report draws.
LEARNING_CURVES = (
    *(f"{phase}/{term}" for phase in ("training", "validation")
      for term in ("confidence", "box", "pose")),
    "validation/mAP", "validation/detected_rate", "validation/tip_mm",
)  # fmt: skip


@stage
def main(config: Config) -> None:
    """Write `ablation.md`, `.json`, `.html` and `figures/` to `out`."""
    out, names = Path(config["out"]), config["variants"]
    results = {name: read_result(RESULTS / name / "evaluation.json", "evaluate") for name in names}
    domain = read_domain()
    rows = [variant_row(name, result) for name, result in results.items()]
    champion = choose_champion(
        {name: last_validation(result["curves"]) for name, result in results.items()},
        config["report"]["champion_margin"],
    )
    shards = ShardedDataset(Path("data/render/images"))
    train, test = annotations(shards, "train"), annotations(shards, "test")
    constant = constant_predictor(train, test).as_dict()
    report = AblationReport(
        rows=rows,
        constant=constant,
        silhouette={
            name: read_result(RESULTS / name / "silhouette.json", "evaluate_real") for name in names
        },
        domain_label=domain,
        champion=champion,
        profile=config["profile"],
        figures=draw_figures(results, rows, constant, domain, out),
    )
    write_report(report, out)
    register(config, results, champion)
    logger.info("%s", to_markdown(report))
    logger.info("champion: %s (%s)", champion.variant, champion.rule)
    logger.info("report: %s", out / "ablation.html")


def annotations(shards: ShardedDataset, part: str) -> list[Annotations]:
    """What is in the images of one part of the split."""
    keys = read_keys(Path("data/split"), part)
    return [shards.annotations(key) for key in tqdm(keys, f"reading {part} poses", unit="image")]


def draw_figures(
    results: dict[str, Any],
    rows: list[VariantRow],
    constant: dict[str, Any],
    domain: str,
    out: Path,
) -> dict[str, Path]:
    """The report's figures: title -> file."""
    titled = {
        variant_title(name, domain, result["title"]): result for name, result in results.items()
    }
    curves = {
        title: PrecisionRecall(
            **{name: np.array(values) for name, values in result["precision_recall"].items()}
        )
        for title, result in titled.items()
    }
    learning = {
        title: [[tuple(row) for row in result["curves"] if row[1] in LEARNING_CURVES]]
        for title, result in titled.items()
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


def write_report(report: AblationReport, out: Path) -> None:
    """The three forms of the report."""
    forms = {"md": to_markdown, "json": to_json, "html": to_html}
    for suffix, write in forms.items():
        with new_file(out / f"ablation.{suffix}") as part:
            part.write_text(write(report))


def register(config: Config, results: dict[str, Any], champion: Champion) -> None:
    """Register the champion's model with MLflow."""
    tracking.connect(**config["tracking"])
    training_id = results[champion.variant]["training"]["training_id"]
    tracking.register_champion(training_id, champion.variant, champion.rule)


if __name__ == "__main__":
    main()
