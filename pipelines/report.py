"""Stage `report`: all variants next to the paper's tables; the best one is registered."""

from pathlib import Path

from shaftpose.report import writing
from shaftpose.report.ablation import AblationReport
from shaftpose.report.champion import candidate, choose_champion
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings
from shaftpose.stage_files import read_domain
from shaftpose.tracking.connection import connect
from shaftpose.tracking.parents import log_report
from shaftpose.tracking.registry import register_candidate
from shaftpose.tracking.trainings import training_link

RESULTS, SPLIT, IMAGES = Path("data/results"), Path("data/split"), Path("data/render/images")


@stage
def main(settings: Settings) -> None:
    """Write `ablation.md`, `.json`, `.html` and `figures/` to `out`."""
    evaluations = writing.read_evaluations(RESULTS, settings.variants)
    report = AblationReport(
        rows=writing.all_rows(evaluations, writing.read_silhouettes(RESULTS, settings.variants)),
        constant=writing.constant_metrics(IMAGES, SPLIT),
        domain_label=read_domain(Path("data/real")),
        champion=choose_champion(evaluations, settings.report.champion_margin),
        profile=settings.profile,
    )
    connect(settings.tracking.uri, settings.tracking.experiment)
    links = {n: training_link(one.training.training_id) for n, one in evaluations.items()}
    results = {name: RESULTS / name for name in evaluations}
    writing.write_report(report, evaluations, links, results, settings.out)
    log_report(settings.out / "ablation.html")
    register_candidate(*candidate(report.champion, evaluations, settings))


if __name__ == "__main__":
    main()
