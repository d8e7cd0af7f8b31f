"""Small shards for tests."""

import tarfile
from pathlib import Path

import numpy as np

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.masks import mask_box
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter

SIZE = 64
CAMERA = Camera.from_field_of_view(SIZE, SIZE, 95.0)


def rectangle(x0: int, y0: int, x1: int, y1: int) -> np.ndarray:
    mask = np.zeros((SIZE, SIZE), dtype=bool)
    mask[y0:y1, x0:x1] = True
    return mask


def instrument(pose: ShaftPose, mask: np.ndarray) -> Instrument:
    """A partly hidden instrument: its amodal mask is 4 px wider on the right."""
    x0, y0, x1, y1 = mask_box(mask)
    return Instrument(pose, mask, rectangle(x0, y0, x1 + 4, y1))


def make_sample(index: int, shafts: int = 2) -> Sample:
    """An image of coarse noise, which JPEG preserves, with `shafts` rectangles."""
    rng = np.random.default_rng(index)
    cells = rng.integers(0, 256, (SIZE // 16, SIZE // 16, 3), dtype=np.uint8)
    poses = [ShaftPose(1.5, -2.25, 20.0, 70.0, 123.0), ShaftPose(-4.0, 3.0, 31.0, 55.0, 1.0)]
    masks = [rectangle(3, 5, 20, 9), rectangle(30, 10, 41, 60)]
    instruments = [instrument(pose, mask) for pose, mask in zip(poses, masks, strict=True)]
    return Sample(
        key=sample_key(index),
        rgb=cells.repeat(16, axis=0).repeat(16, axis=1),
        instruments=tuple(instruments[:shafts]),
        camera=CAMERA,
        scene_description={"background": "b7", "light": 3.5, "seeds": [1, index]},
    )


def write_shard(path: Path, samples: list[Sample], quality: int = 95) -> None:
    with ShardWriter(path, quality) as writer:
        for sample in samples:
            writer.write(sample)


def read_member(path: Path, name: str) -> bytes:
    with tarfile.open(path) as tar:
        file = tar.extractfile(name)
        assert file is not None
        return file.read()


def overwrite(path: Path, offset: int, data: bytes) -> None:
    content = bytearray(path.read_bytes())
    content[offset : offset + len(data)] = data
    path.write_bytes(content)


def member(path: Path, name: str) -> tarfile.TarInfo:
    with tarfile.open(path) as tar:
        return tar.getmember(name)
