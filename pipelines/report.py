"""Stage `report`: all variants next to the paper's tables; the best one becomes champion."""

from pathlib import Path

from shaftpose.report.writing import read_evaluations, write_report
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings
from shaftpose.tracking.connection import connect
from shaftpose.tracking.models import register_champion

RESULTS = Path("data/results")


@stage
def main(settings: Settings) -> None:
    """Write `ablation.md`, `.json`, `.html` and `figures/` to `out`."""
    margin = settings.report.champion_margin
    champion = write_report(RESULTS, settings.variants, margin, settings.profile, settings.out)
    training = read_evaluations(RESULTS, [champion.trained])[champion.trained].training
    connect(settings.tracking.uri, settings.tracking.experiment)
    register_champion(training.training_id, champion.trained, champion.rule)


if __name__ == "__main__":
    main()
