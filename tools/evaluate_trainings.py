"""Evaluate trainings of a sweep and record them for docs/results.md.

`python tools/evaluate_trainings.py sweeps/TIME/0 sweeps/TIME/1 --with profile=bench` exports and
evaluates the checkpoint in each folder, with the settings that it was trained with, and writes
`reports/trainings/VARIANT-ID.json`.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import torch

sys.path.insert(0, str(Path(__file__).parents[1] / "pipelines"))

from report import variant_row  # noqa: E402
from results import read_json, read_training, write_json  # noqa: E402

from shaftpose.dataset.coco import read_coco  # noqa: E402
from shaftpose.dataset.split import read_keys  # noqa: E402
from shaftpose.errors import InputError  # noqa: E402
from shaftpose.evaluation.binned_errors import from_plain  # noqa: E402
from shaftpose.evaluation.common_instruments import FoundInstruments  # noqa: E402
from shaftpose.evaluation.training_record import (  # noqa: E402
    TrainingRecord,
    read_recipe,
    validation_curves,
)

RECORDS = Path("reports/trainings")


def main() -> None:
    """Evaluate each folder of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="+", type=Path, help="folders of finished trainings")
    parser.add_argument("--with", nargs="*", default=[], dest="settings", help="Hydra's overrides")
    arguments = parser.parse_args()
    try:
        for folder in arguments.folders:
            evaluate(folder, arguments.settings)
            print(f"recorded in {record(folder)}")
    except InputError as error:
        sys.exit(f"error: {error}")


def evaluate(folder: Path, settings: list[str]) -> None:
    """Export the folder's checkpoint and evaluate it, results beside it."""
    check_images(folder)
    places = [f"variant={variant_of(folder)}", f"model_folder={folder}", f"out={folder}"]
    for stage in ("export", "evaluate"):
        done = subprocess.run([sys.executable, f"pipelines/{stage}.py", *places, *settings])
        if done.returncode:
            raise InputError(f"{folder}: {stage} failed, see above; give its settings by --with")


def check_images(folder: Path) -> None:
    """Raise InputError if the training was on other images than those in data/."""
    trained = read_training(folder)["training_images"]
    images = len(read_keys(Path("data/split"), "train"))
    if trained != images:
        raise InputError(
            f"{folder}: was trained on {trained:,} images, but data/split has {images:,} to train "
            "on: run `dvc repro split real_images` at the profile of the training"
        )


def variant_of(folder: Path) -> str:
    """The variant that the folder's checkpoint says it is."""
    path = folder / "model.ckpt"
    if not path.is_file():
        raise InputError(f"{path}: missing; the folder must be that of a finished training")
    return str(torch.load(path, weights_only=True, map_location="cpu")["identity"]["variant"])


def record(folder: Path) -> Path:
    """Write what is kept of the training where `make results` finds it."""
    variant, training = variant_of(folder), read_training(folder)
    recipe = read_recipe(training, str(folder / "training.json"))
    result = read_json(folder / "evaluation.json", "evaluate")
    row = variant_row(variant, result, len(read_coco(Path("data/real/train.json"))))
    binned, curves = from_plain(result["binned_errors"]), validation_curves(result["curves"])
    found = FoundInstruments(**result["found"])
    path = RECORDS / f"{variant}-{training['training_id'][:8]}.json"
    write_json(path, TrainingRecord(row, recipe, binned, found, curves).as_plain())
    return path


if __name__ == "__main__":
    main()
