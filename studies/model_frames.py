"""Test images for a bundled model, and bounds for its errors on them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from shaftpose.core.files import read_json, write_json
from shaftpose.core.images import write_jpeg
from shaftpose.core.instruments import Annotations
from shaftpose.core.shards import ShardedDataset
from shaftpose.image_files.reading import read_rgb
from shaftpose.inference.predictor import Predictor
from shaftpose.metrics.pose_errors import PoseErrors, pose_errors

COUNT = 3
# Bounds are FACTOR times the exported model's mean error plus MARGIN in mm or deg. This allows for
# 16-bit weights and rounding on other processors, but not for damage.
FACTOR, MARGIN = 1.1, 0.1


def write_frames(
    folder: Path, shards: ShardedDataset, keys: Sequence[str], exported: Predictor
) -> None:
    """Write the first images that show an instrument, and frames.json: their boxes in px, poses in
    mm and deg, and bounds from the exported model's errors."""
    chosen = [key for key in keys if len(shards.annotations(key).boxes)][:COUNT]
    frames = []
    for place, key in enumerate(chosen):
        annotations = shards.annotations(key)
        assert annotations.poses is not None
        known = {"boxes": annotations.boxes.tolist(), "poses": annotations.poses.tolist()}
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
    """Errors of a model on a folder's frames that exceed the bounds, one line each."""
    content = read_json(folder / "frames.json", "run python -m studies.bundle_model")
    errors, bounds = _errors(predictor, content, folder), content["bounds"]
    if len(errors.tip_mm) < content["found"]:
        return [f"finds {len(errors.tip_mm)} instruments, not {content['found']}"]
    return [
        f"{name} is {error:.3f}, above {bounds[name]}"
        for name, error in errors.means().items()
        if error is not None and bounds[name] is not None and not error <= bounds[name]
    ]


def _errors(predictor: Predictor, content: Mapping[str, Any], folder: Path) -> PoseErrors:
    """Errors of the instruments that a model detects in the frames."""
    frames = content["frames"]
    found = predictor(np.stack([read_rgb(folder / frame["image"]) for frame in frames]))
    known = [Annotations(np.array(frame["boxes"]), np.array(frame["poses"])) for frame in frames]
    return pose_errors(found, known, content["confidence"])
