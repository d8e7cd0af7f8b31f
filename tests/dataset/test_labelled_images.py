"""Images with their annotations, from shards and from COCO files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.instruments import UNKNOWN
from shaftpose.core.samples import sample_key
from shaftpose.dataset.compressed_masks import CompressedMask
from shaftpose.dataset.labelled_images import ImagesInMemory, RenderedImages
from tests.dataset.small_images import BOX, RENDERED, SIZE, coco_images, write_shard


def test_rendered_images_are_the_chosen_ones(tmp_path: Path) -> None:
    images = RenderedImages(write_shard(tmp_path, 4), [sample_key(3), sample_key(0)])
    assert len(images) == 2
    rgb, annotations = images[0]
    assert abs(int(rgb[0, 0, 0]) - 30) <= 1
    assert annotations.boxes.tolist() == [BOX]
    assert annotations.poses is not None
    assert annotations.poses.tolist() == [[3, -2, 20, 70, 123]]
    assert images[1][1].boxes.shape == (0, 4)


def test_images_in_memory_are_the_images(tmp_path: Path) -> None:
    images = ImagesInMemory.of(RENDERED)
    assert len(images) == 30
    assert [int(images[n][0][0, 0, 0]) for n in range(30)] == list(range(30))
    assert images[3][0] is images[3][0]


def test_a_damaged_image_in_memory_is_named_when_it_is_asked_for(tmp_path: Path) -> None:
    images = ImagesInMemory.of(RenderedImages(write_shard(tmp_path, 2), [sample_key(1), "gone"]))
    assert images[0][1].boxes.tolist() == [BOX]
    with pytest.raises(InputError, match="gone"):
        images[1]


def test_real_images_have_boxes_and_no_poses(tmp_path: Path) -> None:
    images = coco_images(tmp_path)
    rgb, annotations = images[0]
    assert (len(images), rgb.shape) == (1, (SIZE, SIZE, 3))
    assert annotations.boxes.tolist() == [BOX]
    assert annotations.poses is None


def test_a_shaft_that_was_left_out_is_unknown_and_no_background(tmp_path: Path) -> None:
    real = replace(coco_images(tmp_path), with_instances=True)
    axis = ((20.0, 9.0), (14.0, 23.0))
    mask = np.zeros((SIZE, 48), dtype=np.uint8)
    mask[8:24, 12:24] = 1
    shown = replace(real.images[0].instruments[0], mask=CompressedMask.of(mask), axis=axis)
    aside = np.zeros((SIZE, 48), dtype=np.uint8)
    aside[:, 39:] = 1  # one of nine columns is in the square, columns 8 to 40, less than a fifth
    left_out = replace(shown, box=(39.0, 0.0, 48.0, float(SIZE)), mask=CompressedMask.of(aside))
    image = replace(real.images[0], instruments=(shown, left_out))
    known = replace(real, images=[image])[0][1]
    assert known.instances is not None and known.tips_px is not None
    expected = mask[:, 8:40].copy()
    expected[aside[:, 8:40] > 0] = UNKNOWN
    assert len(known.boxes) == 1
    np.testing.assert_array_equal(known.instances, expected)
    assert np.isnan(known.tips_px).all()


def test_what_the_box_of_a_crowd_shows_is_unknown(tmp_path: Path) -> None:
    real = replace(coco_images(tmp_path), with_instances=True)
    shown = real.images[0].instruments[0]
    crowd = replace(shown, box=(10.0, 4.0, 30.0, 12.0), mask=None)
    image = replace(real.images[0], instruments=(), crowds=(crowd,))
    known = replace(real, images=[image])[0][1]
    expected = np.zeros((SIZE, SIZE), dtype=np.uint8)
    expected[4:12, 2:22] = UNKNOWN  # the square starts at column 8
    assert known.instances is not None and len(known.boxes) == 0
    np.testing.assert_array_equal(known.instances, expected)


def test_masks_of_real_images_are_known_only_if_every_shaft_has_one(tmp_path: Path) -> None:
    boxed = replace(coco_images(tmp_path), with_instances=True)
    assert boxed[0][1].instances is not None
    assert np.all(boxed[0][1].instances == UNKNOWN)
    mask = np.zeros((SIZE, 48), dtype=np.uint8)
    mask[8:24, 12:24] = 1
    image = boxed.images[0]
    shaft = replace(image.instruments[0], mask=CompressedMask.of(mask))
    masked = replace(boxed, images=[replace(image, instruments=(shaft,))])
    np.testing.assert_array_equal(masked[0][1].instances, mask[:, 8:40])
