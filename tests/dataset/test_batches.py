"""Padded batches."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from shaftpose.core.instruments import Annotations
from shaftpose.core.samples import sample_key
from shaftpose.dataset.batches import LabelledImage, pad_batch
from shaftpose.dataset.labelled_images import RenderedImages
from tests.dataset.small_images import BOX, POSE, SIZE, coco_images, write_shard


def labelled(boxes: list[list[float]], with_poses: bool = True) -> LabelledImage:
    poses = np.array([POSE] * len(boxes)).reshape(-1, 5) if with_poses else None
    annotations = Annotations(np.array(boxes, dtype=float).reshape(-1, 4), poses)
    return np.full((SIZE, SIZE, 3), len(boxes), dtype=np.uint8), annotations


def test_a_batch_is_padded() -> None:
    batch = pad_batch([labelled([BOX]), labelled([BOX, [0, 0, 32, 32]], False), labelled([])])
    images, targets = batch
    assert (images.shape, images.dtype) == ((3, SIZE, SIZE, 3), torch.uint8)
    assert images[:, 0, 0, 0].tolist() == [1, 2, 0]
    # Boxes in units of the side, 32: 4, 8, 16, 24 -> 1/8, 1/4, 1/2, 3/4.
    unit, none = [0.125, 0.25, 0.5, 0.75], [0.0] * 4
    assert targets.boxes.tolist() == [[unit, none], [unit, [0, 0, 1, 1]], [none, none]]
    assert targets.boxes.dtype == torch.float32
    assert targets.poses.tolist() == [[POSE, [0] * 5], [[0] * 5] * 2, [[0] * 5] * 2]
    assert targets.valid.tolist() == [[True, False], [True, True], [False, False]]
    # An image without instruments counts as having all poses.
    assert targets.has_pose.tolist() == [True, False, True]
    assert (targets.valid.dtype, targets.has_pose.dtype) == (torch.bool, torch.bool)


def test_a_batch_without_instruments_has_one_empty_place() -> None:
    targets = pad_batch([labelled([]), labelled([])]).targets
    assert targets.boxes.shape == (2, 1, 4)
    assert targets.poses.shape == (2, 1, 5)
    assert not targets.valid.any()


def test_batches_hold_the_annotated_tips_of_real_images(tmp_path: Path) -> None:
    real = coco_images(tmp_path)
    axis = ((20.0, 9.0), (14.0, 23.0))
    shaft = replace(real.images[0].instruments[0], axis=axis)
    known = replace(real, images=[replace(real.images[0], instruments=(shaft,))])
    np.testing.assert_allclose(known[0][1].tips_px, [[12, 9]])  # the square starts at column 8
    rendered = RenderedImages(write_shard(tmp_path, 1), [sample_key(0)])
    assert pad_batch([rendered[0]]).targets.tips_px is None
    tips = pad_batch([rendered[0], known[0], real[0]]).targets.tips_px
    assert tips is not None
    np.testing.assert_allclose(tips[:, 0], [[np.nan] * 2, [12, 9], [np.nan] * 2])
