"""Image sets of the stage `evaluate_real`."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import write_jpeg
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter, shard_name
from shaftpose.dataset.coco import write_coco
from shaftpose.dataset.coco_images import SquareImage
from shaftpose.evaluation.masked_images import MaskedImage, masked_images

SIDE = 32
GREY = np.full((SIDE, SIDE, 3), 128, dtype=np.uint8)
MASK = np.zeros((SIDE, SIDE), dtype=bool)
MASK[4:12, 8:24] = True
BOX = (8, 4, 24, 12)
AXIS = np.array([[[8.0, 8.0], [24.0, 8.5]]])
CAMERA = Camera.from_field_of_view(SIDE, SIDE, 95.0)
DISTORTED = replace(CAMERA, k1=-0.02, k2=0.01, field=CAMERA.disc(30.0))


def write_rendered(folder: Path) -> None:
    """One image with one shaft."""
    pose = ShaftPose.from_array(np.array([0.0, 0.0, 20.0, 70.0, 10.0]))
    shaft = Instrument(pose, MASK, MASK)
    with ShardWriter(folder / shard_name(0), jpeg_quality=90) as writer:
        writer.write(Sample(sample_key(0), GREY, (shaft,), DISTORTED, {}))


def write_real(folder: Path, occluded: list[bool]) -> None:
    """Write one image with a shaft for each entry of `occluded`, and one without shafts."""
    boxes = np.array([BOX], dtype=float)
    samples = [SquareImage(GREY, boxes, (MASK,), AXIS, hidden) for hidden in occluded]
    samples.append(SquareImage(GREY, np.empty((0, 4)), (), np.empty((0, 2, 2)), False))
    named = [(f"images/{n}.jpg", sample) for n, sample in enumerate(samples)]
    for name, sample in named:
        write_jpeg(sample.rgb, folder / name)
    write_coco(folder / "test.json", named, with_masks=True, description="")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("clear", "occluded"):
        write_rendered(tmp_path / "render" / name)
    return tmp_path


def read(folder: Path, domain: str) -> dict[str, list[MaskedImage]]:
    return masked_images(folder / "render", folder / "real", domain, CAMERA)


@pytest.mark.parametrize("domain", ["real", "stand-in"])
def test_sets_bear_the_name_of_their_domain(folder: Path, domain: str) -> None:
    write_real(folder / "real", [True, False, True])
    sets = read(folder, domain)
    assert {name: len(images) for name, images in sets.items()} == {
        "rendered/clear": 1, "rendered/occluded": 1, f"{domain}/clear": 1, f"{domain}/occluded": 2,
    }  # fmt: skip
    for images in sets.values():
        np.testing.assert_allclose(images[0].known.boxes, [BOX])
        np.testing.assert_array_equal(images[0].masks[0], MASK)
    np.testing.assert_allclose(sets[f"{domain}/clear"][0].axes, AXIS)
    # The rendered shaft: x = sin 70 cos 10, y = sin 70 sin 10 of the way to the handle.
    (tip, other) = sets["rendered/clear"][0].axes[0]
    np.testing.assert_allclose(tip, [16, 16])
    np.testing.assert_allclose(np.degrees(np.arctan2(*(other - tip)[::-1])), 10)
    assert sets["rendered/clear"][0].known.poses is not None
    assert sets["rendered/clear"][0].camera == DISTORTED
    assert sets[f"{domain}/clear"][0].camera == CAMERA
    assert sets[f"{domain}/clear"][0].known.poses is None


def test_a_set_without_images_is_left_out(folder: Path) -> None:
    write_real(folder / "real", [False])
    assert "stand-in/occluded" not in read(folder, "stand-in")


def test_pixels_of_crowds_are_left_out(folder: Path) -> None:
    write_real(folder / "real", [False, False])
    path = folder / "real/test.json"
    content = json.loads(path.read_text())
    crowd = {"id": 9, "image_id": content["images"][0]["id"], "bbox": [2, 20, 6, 8], "iscrowd": 1}
    content["annotations"].append(crowd)
    path.write_text(json.dumps(content))
    with_crowd, without = read(folder, "real")["real/clear"]
    expected = np.zeros((SIDE, SIDE), dtype=bool)
    expected[20:28, 2:8] = True
    np.testing.assert_array_equal(with_crowd.left_out, expected)
    assert without.left_out is None
