"""Rendered images as if they were real: boxes, masks in tests, no poses."""

from collections.abc import Iterator
from pathlib import Path

from shaftpose.core.geometry import projected_axes
from shaftpose.core.images import write_jpeg
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.coco import write_coco
from shaftpose.dataset.real_images import RealSample


def write_stand_in(rendered: Path, out: Path) -> None:
    """Write `images/`, `train.json` and `test.json` to `out`, the stand-in for real images.

    rendered: folder of the sets `train`, `clear` and `occluded`; the last two are the test images.
    """
    samples = {name: list(_samples(rendered / name)) for name in ("train", "clear", "occluded")}
    for name, sample in [pair for pairs in samples.values() for pair in pairs]:
        write_jpeg(sample.rgb, out / name)
    about = "stand-in for real endoscopic images, rendered; no poses"
    write_coco(out / "train.json", samples["train"], with_masks=False, description=about)
    test = samples["clear"] + samples["occluded"]
    write_coco(out / "test.json", test, with_masks=True, description=about)


def _samples(folder: Path) -> Iterator[tuple[str, RealSample]]:
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
        yield f"images/{folder.name}-{key}.jpg", sample
