"""Small images for tests of the training data."""

from pathlib import Path

import numpy as np

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import write_jpeg
from shaftpose.core.instruments import Annotations
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.batches import LabelledImage
from shaftpose.dataset.coco_images import CocoImage, CocoInstrument
from shaftpose.dataset.labelled_images import CocoImages, Images
from shaftpose.dataset.training_stream import TrainingStream

SIZE = 32
BOX = [4.0, 8.0, 16.0, 24.0]
POSE = [1.0, -2.0, 20.0, 70.0, 123.0]


class Numbered(Images):
    """Image n is filled with the level `first` + n."""

    def __init__(self, first: int, count: int, has_pose: bool) -> None:
        self.first, self.count, self.has_pose = first, count, has_pose

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> LabelledImage:
        rgb = np.full((SIZE, SIZE, 3), self.first + index, dtype=np.uint8)
        poses = np.array([POSE]) if self.has_pose else None
        return rgb, Annotations(np.array([BOX]), poses)


RENDERED = Numbered(0, 30, has_pose=True)
MIXED_IN = Numbered(100, 7, has_pose=False)


def stream(length: int = 110, share: float = 2 / 11, seed: int = 5) -> TrainingStream:
    return TrainingStream(RENDERED, MIXED_IN, share, (), length, seed)


def write_shard(folder: Path, count: int) -> ShardedDataset:
    """Image n is of level 10 n and has one shaft at x = n mm; image 0 has none."""
    mask = np.zeros((SIZE, SIZE), dtype=bool)
    mask[8:24, 4:16] = True
    with ShardWriter(folder / "shard-000000.tar", 95) as writer:
        for n in range(count):
            pose = ShaftPose(float(n), -2.0, 20.0, 70.0, 123.0)
            shaft = Instrument(pose, mask, mask)
            rgb = np.full((SIZE, SIZE, 3), 10 * n, dtype=np.uint8)
            camera = Camera.from_field_of_view(SIZE, SIZE, 95.0)
            writer.write(Sample(sample_key(n), rgb, (shaft,) if n else (), camera, {}))
    return ShardedDataset(folder)


def coco_images(folder: Path) -> CocoImages:
    path = folder / "real.jpg"
    write_jpeg(np.full((SIZE, 48, 3), 200, dtype=np.uint8), path)
    # 48 x 32: the square starts at column 8.
    shaft = CocoInstrument((12.0, 8.0, 24.0, 24.0), None, occluded=False)
    return CocoImages([CocoImage(path, 48, SIZE, (shaft,))], SIZE)
