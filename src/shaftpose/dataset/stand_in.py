"""Rendered images as if they were real: boxes, masks and axes, but no poses."""

from collections.abc import Iterator
from pathlib import Path

from shaftpose.core.geometry import projected_axes
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.coco import RealSample


def read_samples(folder: Path, name: str) -> Iterator[tuple[str, RealSample]]:
    """The images of a rendered set, with file names that begin with the set's name."""
    shards = ShardedDataset(folder)
    for key in shards.keys:
        known = shards.annotations(key)
        assert known.poses is not None
        sample = RealSample(
            rgb=shards.rgb(key),
            boxes=known.boxes,
            masks=tuple(shards.masks(key)),
            axes=projected_axes(known.poses, shards.camera(key)),
            occluded=bool(shards.facts(key)["occluders"]),
        )
        yield f"images/{name}-{key}.jpg", sample
