"""A finished training's model in 8 bits, compared with the exported one.

`python -m studies.quantise models/d` takes the ranges of values from training images and writes
`model_8bit.onnx` beside the folder's `model.onnx`. Nothing is written if its network, without a fit
of poses, loses more on the validation and test images in data/ than MAP_LOSS and SHARE_LOST allow.
Wide networks run fastest by `shaftpose predict --backend openvino`.
"""

import argparse
from pathlib import Path

from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.files import new_file
from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.split import first_images, read_keys
from shaftpose.export.compression import quantise
from shaftpose.inference.predictor import Predictor
from shaftpose.training.fingerprint import rendered_digest
from studies.evaluate_trainings import check
from studies.model_comparison import Comparison, compare

IMAGES, SPLIT = Path("data/render/images"), Path("data/split")
CALIBRATION_IMAGES = 200
# What may be lost: of the mAP, a difference; of the detected rate and the errors, a share.
MAP_LOSS, SHARE_LOST = 0.005, 0.02


def main() -> None:
    """Write the model of the folder of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of an exported training")
    with exit_on_input_error():
        print(f"written to {eight_bit_model(parser.parse_args().folder)}")


def eight_bit_model(folder: Path) -> Path:
    """Compare and write. Raises InputError, and writes nothing, if it loses too much."""
    check(folder, rendered_digest(IMAGES, SPLIT))
    path, out = folder / "model.onnx", folder / "model_8bit.onnx"
    # Without the fit, which does not compute in 8 bits and sometimes ends elsewhere.
    exported, keys = Predictor(path, "none"), evaluated_keys()
    with new_file(out) as part:
        quantise(path, part, first_images(IMAGES, SPLIT, "train", CALIBRATION_IMAGES))
        found = compare(exported, Predictor(part, "none"), ShardedDataset(IMAGES), keys)
        print(f"{found}; {growth(found)}")
        if losses := too_much_lost(found):
            raise InputError(f"{path}: loses too much in 8 bits: {'; '.join(losses)}")
    return out


def evaluated_keys() -> list[str]:
    """All images that are not trained on: of few, single wrong poses would decide."""
    return [*read_keys(SPLIT, "validation"), *read_keys(SPLIT, "test")]


def growth(found: Comparison) -> str:
    """The growth of errors as text."""
    shares = ", ".join(f"{name} {found.growth[name]:+.1%}" for name in POSE_DIMENSIONS)
    return f"errors over the shafts that both find grow by {shares}"


def too_much_lost(found: Comparison) -> list[str]:
    """The metrics that are worse by more than is accepted. Errors are compared over the shafts that
    both find, so that a shaft more or less with a wrong pose does not count as growth."""
    before, after = found.exported["detected_rate"] or 0.0, found.stored["detected_rate"] or 0.0
    losses = [
        f"{name} grows by {found.growth[name]:.1%}"
        for name in POSE_DIMENSIONS
        if not found.growth[name] <= SHARE_LOST
    ]
    if found.map_change < -MAP_LOSS:
        losses.append(f"the mAP falls by {-found.map_change:.4f}")
    if after < (1 - SHARE_LOST) * before:
        losses.append(f"the detected rate falls from {before:.4f} to {after:.4f}")
    return losses


if __name__ == "__main__":
    main()
