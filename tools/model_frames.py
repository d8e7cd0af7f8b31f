"""A few test images that go with a bundled model, and bounds for its errors on them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from results import read_json, write_json

from shaftpose.deployment.predictor import Predictor
from shaftpose.evaluation.pose_errors import PoseErrors, pose_errors
from shaftpose.images import read_rgb, write_jpeg
from shaftpose.instruments import Annotations
from shaftpose.shards import ShardedDataset

COUNT = 3
# The bundled model may have so many times the mean errors of the exported one, and so many mm or
# deg more: room for weights of 16 bits and another processor's rounding, not for damage.
FACTOR, MARGIN = 1.1, 0.1


def write_frames(
    folder: Path, shards: ShardedDataset, keys: Sequence[str], exported: Predictor
) -> None:
    """Write the first images that show an instrument, and frames.json: their boxes in px and poses
    in mm and deg, and the bounds that follow from the exported model's errors."""
    chosen = [key for key in keys if len(shards.annotations(key).boxes)][:COUNT]
    frames = []
    for place, key in enumerate(chosen):
        known = {name: values.tolist() for name, values in vars(shards.annotations(key)).items()}
        frames.append({"image": f"frame_{place}.jpg", **known})
        write_jpeg(shards.rgb(key), folder / f"frame_{place}.jpg")
    content: dict[str, Any] = {"confidence": exported.confidence}
    errors = _errors(exported, content | {"frames": frames}, folder)
    bounds = {
        name: None if error is None else round(FACTOR * error + MARGIN, 3)
        for name, error in errors.means().items()
    }
    found = {"found": len(errors.tip_mm), "bounds": bounds, "frames": frames}
    write_json(folder / "frames.json", content | found)


def complaints(predictor: Predictor, folder: Path) -> list[str]:
    """In what a model does worse on the frames of a folder than their bounds allow."""
    content = read_json(folder / "frames.json", "run tools/bundle_model.py")
    errors, bounds = _errors(predictor, content, folder), content["bounds"]
    if len(errors.tip_mm) < content["found"]:
        return [f"finds {len(errors.tip_mm)} instruments, not {content['found']}"]
    return [
        f"{name} is {error:.3f}, above {bounds[name]}"
        for name, error in errors.means().items()
        if error is not None and not error <= bounds[name]
    ]


def _errors(predictor: Predictor, content: Mapping[str, Any], folder: Path) -> PoseErrors:
    """Errors of the instruments that a model finds in the frames."""
    frames = content["frames"]
    found = predictor(np.stack([read_rgb(folder / frame["image"]) for frame in frames]))
    known = [Annotations(np.array(frame["boxes"]), np.array(frame["poses"])) for frame in frames]
    return pose_errors(found, known, content["confidence"])
