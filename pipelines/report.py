"""Stage `report`: all variants next to the paper's tables; the best one becomes champion."""

from pathlib import Path

from shaftpose import tracking
from shaftpose.json_files import read_result
from shaftpose.report.writing import write_report
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings

RESULTS = Path("data/results")


@stage
def main(settings: Settings) -> None:
    """Write `ablation.md`, `.json`, `.html` and `figures/` to `out`."""
    margin = settings.report.champion_margin
    champion = write_report(RESULTS, settings.variants, margin, settings.profile, settings.out)
    results = read_result(RESULTS / champion.trained / "evaluation.json", "evaluate")
    tracking.connect(settings.tracking.uri, settings.tracking.experiment)
    training_id = results["training"]["training_id"]
    tracking.register_champion(training_id, champion.trained, champion.rule)


if __name__ == "__main__":
    main()
