"""Stage `report`: all variants next to the paper's tables; the best one becomes champion."""

from pathlib import Path

from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.split import read_keys
from shaftpose.metrics.metrics import constant_predictor
from shaftpose.report import writing
from shaftpose.report.ablation import AblationReport, choose_champion
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings
from shaftpose.stage_files import read_domain
from shaftpose.tracking.connection import connect
from shaftpose.tracking.models import register_champion

RESULTS, SPLIT = Path("data/results"), Path("data/split")


@stage
def main(settings: Settings) -> None:
    """Write `ablation.md`, `.json`, `.html` and `figures/` to `out`."""
    evaluations = writing.read_evaluations(RESULTS, settings.variants)
    silhouettes = writing.read_silhouettes(RESULTS, settings.variants)
    shards = ShardedDataset(Path("data/render/images"))
    train, test = (writing.annotations(shards, read_keys(SPLIT, p)) for p in ("train", "test"))
    report = AblationReport(
        rows=writing.all_rows(evaluations, silhouettes),
        constant=constant_predictor(train, test),
        domain_label=read_domain(Path("data/real")),
        champion=choose_champion(evaluations, settings.report.champion_margin),
        profile=settings.profile,
    )
    writing.write_report(report, evaluations, settings.out)
    name, rule = report.champion.variant, report.champion.rule
    connect(settings.tracking.uri, settings.tracking.experiment)
    register_champion(evaluations[name].training.training_id, name, rule)


if __name__ == "__main__":
    main()
