"""Training data in miniature: the outputs of the earlier stages, but quickly drawn."""

import json
from pathlib import Path

import numpy as np

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import write_jpeg
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter, shard_name
from shaftpose.dataset.split import Split, write_split
from shaftpose.training.data import DataFolders

# Where the data are, seen from the folder that holds them.
FOLDERS = DataFolders(Path("data/render/images"), Path("data/split"), Path("data/real"))
SIDE = 299
PER_SHARD = 6
OUTLINE = [100, 50, 180, 50, 180, 250, 100, 250]


def write_training_data(folder: Path) -> None:
    """Two shards of six images, their split, and two real images."""
    for number in range(2):
        path = folder / "data/render/images" / shard_name(number)
        with ShardWriter(path, 95) as writer:
            for n in range(PER_SHARD):
                writer.write(sample(number * PER_SHARD + n))
    keys = [sample_key(n) for n in range(2 * PER_SHARD)]
    split = Split(train=keys[:8], validation=keys[8:10], test=keys[10:])
    write_split(split, folder / "data/split")
    write_real(folder / "data/real")


def sample(index: int) -> Sample:
    """Noise with one or two bright bars, or none in every fifth image."""
    rng = np.random.default_rng(index)
    rgb = rng.integers(0, 120, (SIDE, SIDE, 3), dtype=np.uint8)
    shafts = []
    for _ in range(0 if index % 5 == 4 else 1 + index % 2):
        left, top = rng.integers(0, 150, 2)
        mask = np.zeros((SIDE, SIDE), dtype=bool)
        mask[top : top + 120, left : left + 60] = True
        rgb[mask] += 100
        pose = ShaftPose(*rng.uniform([-20, -20, 10, 50, 0], [20, 20, 40, 90, 358]).tolist())
        shafts.append(Instrument(pose, mask, mask))
    camera = Camera.from_field_of_view(SIDE, SIDE, 95.0)
    return Sample(sample_key(index), rgb, tuple(shafts), camera, {"source": f"s{index}"})


def write_real(folder: Path) -> None:
    """Two real images with a shaft each, as the training part of the real data."""
    for n in range(2):
        rgb = np.random.default_rng(n).integers(0, 255, (SIDE, 400, 3), dtype=np.uint8)
        write_jpeg(rgb, folder / f"images/{n}.jpg")
    content = {
        "images": [
            {"id": n, "file_name": f"images/{n}.jpg", "width": 400, "height": SIDE}
            for n in range(2)
        ],
        "annotations": [
            {"image_id": n, "bbox": [100, 50, 80, 200], "segmentation": [OUTLINE]} for n in range(2)
        ],
    }
    (folder / "train.json").write_text(json.dumps(content))
    (folder / "about.json").write_text(json.dumps({"domain": "real"}))
