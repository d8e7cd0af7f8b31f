"""Evaluate trainings of a sweep and record them for docs/results.md.

`python -m studies.evaluate_trainings sweeps/TIME/0 sweeps/TIME/1 --with profile=bench` exports and
evaluates the checkpoint in each folder, silhouettes included, and writes
`reports/trainings/VARIANT-SEED-ID.json`, and `VARIANT-SEED-ID-refined.json` for refined poses. The
settings are those of params.yaml, with the overrides of the training's command given by `--with`.
"""

import argparse
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.files import write_json
from shaftpose.evaluation.results import Evaluation, Silhouettes
from shaftpose.network.checkpoint import identity_of
from shaftpose.report.ablation import VariantRow, variant_rows
from shaftpose.stage_files import TrainingRecord, read_stage_file, read_training
from shaftpose.training.fingerprint import rendered_digest
from studies.record import EvaluatedTraining, validation_curves

RECORDS = Path("reports/trainings")


def main() -> None:
    """Evaluate each folder of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="+", type=Path, help="folders of finished trainings")
    parser.add_argument("--with", nargs="*", default=[], dest="settings", help="Hydra's overrides")
    arguments = parser.parse_args()
    with exit_on_input_error():
        data = rendered_digest(Path("data/render/images"), Path("data/split"))
        for folder in arguments.folders:
            check(folder, data)
        for folder in arguments.folders:
            evaluate(folder, arguments.settings)
            print(f"recorded in {', '.join(map(str, record(folder)))}")


def check(folder: Path, data: str) -> None:
    """Raise InputError unless the folder holds a finished training on the images in data/, which
    have the digest `data`."""
    if finished(folder).data.digest != data:
        raise InputError(
            f"{folder}: was trained on other images than those in data/: run `dvc repro split` "
            "with the settings of its images"
        )
    variant_of(folder)


def finished(folder: Path) -> TrainingRecord:
    """The facts that the train stage recorded about a finished training."""
    return read_training(folder, "run the training, or its sweep, to its end, or leave it out")


def evaluate(folder: Path, settings: list[str]) -> None:
    """Export the folder's checkpoint and evaluate it in the same folder.

    The model's own confidence threshold replaces that of params.yaml. Raises InputError if a stage
    fails.
    """
    places = [f"variant={variant_of(folder)}", f"model_folder={folder}", f"out={folder}"]
    for stage in ("export", "evaluate", "evaluate_real"):
        script = [sys.executable, f"pipelines/{stage}.py", *places, *settings]
        if subprocess.run([*script, "detection.confidence_threshold=null"]).returncode:
            raise InputError(f"{folder}: {stage} failed, see above; give its settings by --with")


def variant_of(folder: Path) -> str:
    """The variant stated in the folder's checkpoint. Raises InputError if there is none."""
    return str(identity_of(folder / "model.ckpt")["variant"])


def record(folder: Path) -> list[Path]:
    """Write the records of the training for `make results`; returns their paths."""
    evaluation = read_stage_file(folder / "evaluation.json", Evaluation, "evaluate it again")
    silhouettes = read_stage_file(folder / "silhouette.json", Silhouettes, "evaluate it again")
    training, paths = evaluation.training, []
    for row in variant_rows(variant_of(folder), evaluation, silhouettes):
        name = f"{row.variant}-{training.seed}-{training.training_id[:8]}"
        paths.append(RECORDS / f"{name}{'-refined' if row.refined else ''}.json")
        write_json(paths[-1], asdict(training_record(row, evaluation)))
    return paths


def training_record(row: VariantRow, evaluation: Evaluation) -> EvaluatedTraining:
    """The record of a row of Table I. Curves are in that of the network's own poses alone."""
    training = evaluation.training
    accuracy = evaluation.refined if row.refined and evaluation.refined else evaluation.raw
    return EvaluatedTraining(
        row=row,
        recipe={**training.recipe, "detection": evaluation.detection},
        variant=training.variant,
        data=training.data.digest,
        mixed_in=training.data.mixed_in,
        binned_errors=accuracy.binned_errors,
        found=accuracy.found,
        curves=[] if row.refined else validation_curves(evaluation.curves),
    )


if __name__ == "__main__":
    main()
