"""Compare evaluated trainings, such as the jobs of a sweep, in a report of their own.

`python -m studies.compare_runs sweeps/TIME/0 sweeps/TIME/1 --out reports/comparison` takes folders
that `python -m studies.evaluate_trainings` has evaluated.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from shaftpose.core.errors import exit_on_input_error
from shaftpose.evaluation.results import Evaluation
from shaftpose.report import writing
from shaftpose.report.ablation import AblationReport, variant_rows
from shaftpose.report.champion import choose_champion
from shaftpose.settings.compose import composed_settings
from shaftpose.stage_files import read_domain, read_stage_file
from shaftpose.tracking.connection import connect
from shaftpose.tracking.trainings import training_link
from studies.evaluate_trainings import variant_of

IMAGES, SPLIT, REAL = Path("data/render/images"), Path("data/split"), Path("data/real")


def main() -> None:
    """Write the report of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="+", type=Path, help="of evaluated trainings")
    parser.add_argument("--out", type=Path, required=True, help="folder of the report")
    arguments = parser.parse_args()
    with exit_on_input_error():
        compare(arguments.folders, arguments.out)
    print(f"report: {arguments.out / 'ablation.html'}")


def compare(folders: list[Path], out: Path) -> None:
    """Write a report with a row for each folder. Raises InputError if one is not evaluated."""
    settings = composed_settings(Path())
    places = {named(folder): folder for folder in folders}
    evaluations = {name: evaluation(folder) for name, folder in places.items()}
    report = AblationReport(
        rows=[row for name, one in evaluations.items() for row in variant_rows(name, one)],
        constant=writing.constant_metrics(IMAGES, SPLIT),
        domain_label=read_domain(REAL),
        champion=choose_champion(evaluations, settings.report.champion_margin),
        profile=settings.profile,
    )
    connect(settings.tracking.uri, settings.tracking.experiment)
    links = {name: training_link(one.training.training_id) for name, one in evaluations.items()}
    writing.write_report(report, evaluations, links, places, out)


def named(folder: Path) -> str:
    """The name of a folder's row: its variant and where it is."""
    return f"{variant_of(folder)} {folder}"


def evaluation(folder: Path) -> Evaluation:
    """The evaluation in a folder; its rows are titled by their names."""
    remedy = f"run `python -m studies.evaluate_trainings {folder}`"
    return replace(read_stage_file(folder / "evaluation.json", Evaluation, remedy), title="")


if __name__ == "__main__":
    main()
