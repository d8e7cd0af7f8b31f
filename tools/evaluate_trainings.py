"""Evaluate trainings of a sweep and record them for docs/results.md.

`python tools/evaluate_trainings.py sweeps/TIME/0 sweeps/TIME/1 --with profile=bench` exports and
evaluates the checkpoint in each folder and writes `reports/trainings/VARIANT-SEED-ID.json`. The
settings are those of params.yaml but for what `--with` repeats of the training's command.
"""

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "pipelines"))

from digests import rendered_digest  # noqa: E402
from results import read_json, write_json  # noqa: E402

from shaftpose.errors import InputError  # noqa: E402
from shaftpose.evaluation.ablation import variant_row  # noqa: E402
from shaftpose.evaluation.binned_errors import from_plain  # noqa: E402
from shaftpose.evaluation.common_instruments import FoundInstruments  # noqa: E402
from shaftpose.evaluation.training_record import (  # noqa: E402
    TrainingRecord,
    validation_curves,
    whole,
)
from shaftpose.network.checkpoint import identity_of  # noqa: E402

RECORDS = Path("reports/trainings")


def main() -> None:
    """Evaluate each folder of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="+", type=Path, help="folders of finished trainings")
    parser.add_argument("--with", nargs="*", default=[], dest="settings", help="Hydra's overrides")
    arguments = parser.parse_args()
    try:
        data = rendered_digest()
        for folder in arguments.folders:
            check(folder, data)
        for folder in arguments.folders:
            evaluate(folder, arguments.settings)
            print(f"recorded in {record(folder)}")
    except InputError as error:
        sys.exit(f"error: {error}")


def check(folder: Path, data: str) -> None:
    """Raise InputError unless the folder holds a finished training on the images in data/, of which
    `data` is the digest."""
    training = noted(folder)
    with whole(str(folder / "training.json"), "train again"):
        # `record` will need these.
        trained, *_ = (training[key] for key in ("data", "real", "recipe", "variant"))
    if trained != data:
        raise InputError(
            f"{folder}: was trained on other images than those in data/: run `dvc repro split` "
            "with the settings that they were made with"
        )
    variant_of(folder)


def noted(folder: Path) -> dict[str, Any]:
    """What the train stage notes about a finished training."""
    remedy = "run the training, or its sweep, to its end, or leave the folder out"
    training: dict[str, Any] = read_json(folder / "training.json", remedy)
    return training


def evaluate(folder: Path, settings: list[str]) -> None:
    """Export the folder's checkpoint and evaluate it, results beside it.

    Detections count from the model's own score on, whatever params.yaml says. Raises InputError if
    a stage fails.
    """
    places = [f"variant={variant_of(folder)}", f"model_folder={folder}", f"out={folder}"]
    for stage in ("export", "evaluate"):
        script = [sys.executable, f"pipelines/{stage}.py", *places, *settings]
        if subprocess.run([*script, "detection.confidence=null"]).returncode:
            raise InputError(f"{folder}: {stage} failed, see above; give its settings by --with")


def variant_of(folder: Path) -> str:
    """The variant that the folder's checkpoint says it is. Raises InputError if there is none."""
    return str(identity_of(folder / "model.ckpt")["variant"])


def record(folder: Path) -> Path:
    """Write what is kept of the training where `make results` finds it."""
    training, result = noted(folder), read_json(folder / "evaluation.json", "evaluate it again")
    variant = variant_of(folder)
    one = TrainingRecord(
        row=variant_row(variant, result),
        recipe={**training["recipe"], "detection": result["detection"]},
        variant=training["variant"],
        data=training["data"],
        real=training["real"],
        binned_errors=from_plain(result["binned_errors"]),
        found=FoundInstruments(**result["found"]),
        curves=validation_curves(result["curves"]),
    )
    path = RECORDS / f"{variant}-{training['seed']}-{training['training_id'][:8]}.json"
    write_json(path, one.as_plain())
    return path


if __name__ == "__main__":
    main()
