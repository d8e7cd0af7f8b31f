"""Evaluate trainings of a sweep and record them for docs/results.md.

`python -m studies.evaluate_trainings sweeps/TIME/0 sweeps/TIME/1 --with profile=bench` exports and
evaluates the checkpoint in each folder and writes `reports/trainings/VARIANT-SEED-ID.json`, and a
second file for fitted poses. The settings are those of params.yaml, with the overrides of the
training's command given by `--with`.
"""

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Any

from shaftpose.errors import InputError, exit_on_input_error
from shaftpose.evaluation.binned_errors import from_plain
from shaftpose.evaluation.common_instruments import FoundInstruments
from shaftpose.json_files import read_json, write_json
from shaftpose.network.checkpoint import identity_of
from shaftpose.report.ablation import FIT, variant_row
from shaftpose.report.writing import with_fits
from shaftpose.training.data_identity import rendered_digest
from studies.record import (
    TrainingRecord,
    validation_curves,
    whole,
)

RECORDS = Path("reports/trainings")


def main() -> None:
    """Evaluate each folder of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="+", type=Path, help="folders of finished trainings")
    parser.add_argument("--with", nargs="*", default=[], dest="settings", help="Hydra's overrides")
    arguments = parser.parse_args()
    with exit_on_input_error():
        data = rendered_digest()
        for folder in arguments.folders:
            check(folder, data)
        for folder in arguments.folders:
            evaluate(folder, arguments.settings)
            print(f"recorded in {', '.join(map(str, record(folder)))}")


def check(folder: Path, data: str) -> None:
    """Raise InputError unless the folder holds a finished training on the images in data/, which
    have the digest `data`."""
    training = noted(folder)
    with whole(str(folder / "training.json"), "train again"):
        # `record` needs these keys.
        trained, *_ = (training[key] for key in ("data", "real", "recipe", "variant"))
    if trained != data:
        raise InputError(
            f"{folder}: was trained on other images than those in data/: run `dvc repro split` "
            "with the settings of its images"
        )
    variant_of(folder)


def noted(folder: Path) -> dict[str, Any]:
    """The facts that the train stage recorded about a finished training."""
    remedy = "run the training, or its sweep, to its end, or leave the folder out"
    training: dict[str, Any] = read_json(folder / "training.json", remedy)
    return training


def evaluate(folder: Path, settings: list[str]) -> None:
    """Export the folder's checkpoint and evaluate it in the same folder.

    The model's own confidence threshold replaces that of params.yaml. Raises InputError if a stage
    fails.
    """
    places = [f"variant={variant_of(folder)}", f"model_folder={folder}", f"out={folder}"]
    for stage in ("export", "evaluate"):
        script = [sys.executable, f"pipelines/{stage}.py", *places, *settings]
        if subprocess.run([*script, "detection.confidence_threshold=null"]).returncode:
            raise InputError(f"{folder}: {stage} failed, see above; give its settings by --with")


def variant_of(folder: Path) -> str:
    """The variant stated in the folder's checkpoint. Raises InputError if there is none."""
    return str(identity_of(folder / "model.ckpt")["variant"])


def record(folder: Path) -> list[Path]:
    """Write the records of the training for `make results`; returns their paths."""
    training, result = noted(folder), read_json(folder / "evaluation.json", "evaluate it again")
    paths = []
    for name, one in with_fits({variant_of(folder): result}).items():
        paths.append(RECORDS / f"{name}-{training['seed']}-{training['training_id'][:8]}.json")
        write_json(paths[-1], training_record(name, training, one).as_plain())
    return paths


def training_record(
    variant: str, training: dict[str, Any], result: dict[str, Any]
) -> TrainingRecord:
    """The record of one training from its facts and the results of its evaluation.

    A fit is not trained: its network's record has the curves.
    """
    return TrainingRecord(
        row=variant_row(variant, result),
        recipe={**training["recipe"], "detection": result["detection"]},
        variant=training["variant"],
        data=training["data"],
        real=training["real"],
        binned_errors=from_plain(result["binned_errors"]),
        found=FoundInstruments(**result["found"]),
        curves=[] if variant.endswith(FIT) else validation_curves(result["curves"]),
    )


if __name__ == "__main__":
    main()
