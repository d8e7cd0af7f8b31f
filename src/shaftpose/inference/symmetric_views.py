"""The mean of what a network finds in the eight mirrored and turned copies of an image.

Test-time augmentation. The poses stay exact, see `core.symmetries`; a network that was trained on
such copies errs differently in each.
"""

from collections.abc import Callable, Sequence
from itertools import compress, product

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import axis_direction, pose_along
from shaftpose.core.images import Image
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.core.symmetries import GENERATORS
from shaftpose.metrics.detection.matching import box_iou

_VIEWS = [list(compress(GENERATORS, used)) for used in product((0, 1), repeat=len(GENERATORS))]
# Chosen on validation images:
_LEAST_IOU = 0.6  # of the boxes of one shaft in two copies
_ALIKE = np.cos(np.radians(45.0))  # least cosine between axes whose mean is taken

_NOTHING = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))

Find = Callable[[NDArray[np.uint8]], list[Detections]]


def found_in_views(find: Find, images: NDArray[np.uint8]) -> list[Detections]:
    """The mean detections in images (N, H, W, 3). find: the detections in one copy of each."""
    found = [_found_in_view(find, images, steps) for steps in _VIEWS]
    return [mean_detections(views) for views in zip(*found, strict=True)]


def _found_in_view(
    find: Find, images: NDArray[np.uint8], steps: Sequence[Callable[..., tuple[Image, Annotations]]]
) -> list[Detections]:
    """The detections in images after the steps, in the coordinates of the images before them."""
    copies = []
    for rgb in images:
        for step in steps:
            rgb, _ = step(rgb, Annotations(np.empty((0, 4)), None))
        copies.append(rgb)
    found = []
    for rgb, seen in zip(copies, find(np.stack(copies)), strict=True):
        known = Annotations(seen.boxes, seen.poses)
        for step in reversed(steps):  # each undoes itself
            rgb, known = step(rgb, known)
        assert known.poses is not None
        found.append(Detections(known.boxes, seen.scores, known.poses))
    return found


def mean_detections(views: Sequence[Detections]) -> Detections:
    """The means of detections of the same shaft in several views, best score first.

    The detection with the best score gathers the best one of each view whose box overlaps its own;
    all that overlap are then used up, as in non-maximum suppression. Means are weighted by scores
    (weighted boxes fusion); a view that misses the shaft counts as a score of 0. Some views take
    a shaft's other end for its tip: poses are means over those that agree with most.
    """
    boxes, scores, poses = vars(_joined(views)).values()
    view_of = np.repeat(np.arange(len(views)), [len(view.scores) for view in views])
    left, found = np.argsort(-scores, kind="stable"), [_NOTHING]
    while len(left):
        same = box_iou(boxes[left[:1]], boxes[left])[0] >= _LEAST_IOU
        same[0] = True  # a box without an area, too
        gathered = left[same]
        best = gathered[np.unique(view_of[gathered], return_index=True)[1]]
        found.append(_mean(boxes[best], scores[best], poses[best], len(views)))
        left = left[~same]
    means = _joined(found)
    return means.rows(np.argsort(-means.scores, kind="stable"))


def _mean(
    boxes: NDArray[np.float64], scores: NDArray[np.float64], poses: NDArray[np.float64], views: int
) -> Detections:
    """One detection; arrays as those of `Detections`."""
    axes = axis_direction(poses[:, 3], poses[:, 4])
    cosines = axes @ axes.T
    weights = scores * (cosines[(cosines @ scores).argmax()] > _ALIKE)
    axis, tip = weights @ axes, weights @ poses[:, :3] / weights.sum()
    pose = pose_along(axis / np.linalg.norm(axis), tip).as_array()
    box = scores @ boxes / scores.sum()
    return Detections(box[None], scores.sum(keepdims=True) / views, pose[None])


def _joined(found: Sequence[Detections]) -> Detections:
    """All rows, in this order."""
    columns = zip(*(vars(one).values() for one in found), strict=True)
    return Detections(*(np.concatenate(parts) for parts in columns))
