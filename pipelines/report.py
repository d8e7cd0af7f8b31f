"""Stage `report`: all variants next to the paper's tables; the best one is registered."""

from functools import partial
from pathlib import Path

from shaftpose.report import writing
from shaftpose.report.ablation import AblationReport
from shaftpose.report.champion import choose_champion, is_better, version_tags
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings
from shaftpose.stage_files import read_domain
from shaftpose.tracking.connection import connect
from shaftpose.tracking.parents import log_report
from shaftpose.tracking.registry import register_candidate

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
    writing.write_report(report, evaluations, settings.out)
    best, evaluation = report.champion, evaluations[report.champion.variant]
    tags, training_id = version_tags(settings, evaluation), evaluation.training.training_id
    connect(settings.tracking.uri, settings.tracking.experiment)
    log_report(settings.out / "ablation.html")
    better = partial(is_better, tags, margin=settings.report.champion_margin)
    register_candidate(training_id, best.variant, best.rule, tags, better)


if __name__ == "__main__":
    main()
