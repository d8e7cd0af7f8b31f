"""A finished training's model in 8 bits, compared with the exported one.

`python -m studies.quantise models/d` takes the ranges of values from training images and writes
`model_8bit.onnx` beside the folder's `model.onnx`, and nothing if it is worse on the validation and
test images in data/. Wide networks run fastest by `shaftpose predict --backend openvino`.
"""

import argparse
from pathlib import Path

from shaftpose.core.shards import ShardedDataset
from shaftpose.core.split_lists import first_images, read_keys
from shaftpose.deployment.eight_bits import quantise
from shaftpose.deployment.predictor import Predictor
from shaftpose.errors import InputError, exit_on_input_error
from shaftpose.training.data_identity import rendered_digest
from studies.evaluate_trainings import check
from studies.model_comparison import Comparison, compare

IMAGES, SPLIT = Path("data/render/images"), Path("data/split")
CALIBRATION_IMAGES = 200
# What may be lost: of the mAP, a difference; of the detected rate and the errors, a share.
MAP_LOSS, SHARE_LOST = 0.005, 0.02
ERRORS = ("x_mm", "y_mm", "z_mm", "pitch_deg", "yaw_deg")


def main() -> None:
    """Write the model of the folder of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of an exported training")
    with exit_on_input_error():
        print(f"written to {eight_bit_model(parser.parse_args().folder)}")


def eight_bit_model(folder: Path) -> Path:
    """Write and compare. Raises InputError, and leaves no file, if it loses too much."""
    check(folder, rendered_digest())
    exported, out = folder / "model.onnx", folder / "model_8bit.onnx"
    quantise(exported, out, first_images(IMAGES, SPLIT, "train", CALIBRATION_IMAGES))
    # Without the fit, which does not compute in 8 bits and sometimes ends elsewhere.
    keys = [*read_keys(SPLIT, "validation"), *read_keys(SPLIT, "test")]
    networks = Predictor(exported, "none"), Predictor(out, "none")
    found = compare(*networks, ShardedDataset(IMAGES), keys)
    print(found)
    if losses := too_much_lost(found):
        out.unlink()
        raise InputError(f"{exported}: loses too much in 8 bits: {'; '.join(losses)}")
    return out


def too_much_lost(found: Comparison) -> list[str]:
    """What is worse by more than is accepted. Errors are compared over the shafts that both find: a
    wrong pose more or less would decide otherwise."""
    before, after = found.exported.detected_rate or 0.0, found.stored.detected_rate or 0.0
    losses = [
        f"{name} grows by {found.growth[name]:.1%}"
        for name in ERRORS
        if not found.growth[name] <= SHARE_LOST
    ]
    if found.map_change < -MAP_LOSS:
        losses.append(f"the mAP falls by {-found.map_change:.4f}")
    if after < (1 - SHARE_LOST) * before:
        losses.append(f"the detected rate falls from {before:.4f} to {after:.4f}")
    return losses


if __name__ == "__main__":
    main()
