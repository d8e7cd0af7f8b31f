"""The annotated shafts of whole frames, and the groups that results are stated for."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.dataset.coco_images import CocoImage, covered
from shaftpose.metrics.detection.matching import Array
from shaftpose.metrics.frames.comparison import TrueShafts
from shaftpose.metrics.image_metrics import Mask

# Group -> what belongs to it, as pages say it. A shaft may be crossed and occluded.
GROUPS = {
    "clear": "neither crossed nor occluded",
    "crossed": "their outline meets that of another instrument",
    "occluded": "annotated as occluded, or a twentieth or more of the axis is hidden",
    "hidden": "a quarter or more of the axis is hidden",
}
_OCCLUDED, _HIDDEN = 0.05, 0.25  # hidden shares of the axis, from which a shaft belongs to a group
_MEETS = 3 / 299  # of the frame's shorter side: outlines that come as near meet
_AXIS_STEPS = 200


def true_shafts(image: CocoImage) -> TrueShafts:
    """The shafts of an image. Instruments of unknown shafts, and crowds, are ignored."""
    shafts = image.instruments
    masks = [covered(shaft, image).astype(bool) for shaft in shafts]
    axes = np.array([shaft.axis for shaft in shafts]).reshape(-1, 2, 2)
    tools = [tool.mask.pixels().astype(bool) for tool in image.tools]
    unknown = [mask for mask, tool in zip(tools, image.tools, strict=True) if not tool.shaft_known]
    unknown += [covered(crowd, image).astype(bool) for crowd in image.crowds]
    size = image.height, image.width
    stated = np.array([shaft.occluded for shaft in shafts], dtype=bool)
    hidden = np.array([hidden_share(*pair) for pair in zip(masks, axes, strict=True)])
    return TrueShafts(
        boxes=np.array([shaft.box for shaft in shafts]).reshape(-1, 4),
        masks=masks,
        axes=axes,
        ignored=_union(unknown, size) & ~_union(masks, size),
        tools=_union(tools, size) if tools else None,
        hidden_shares=hidden,
        groups=_groups(stated, hidden, _crossed(masks, tools)),
    )


def hidden_share(mask: Mask, axis: Array) -> float:
    """The share of an axis (2, 2), tip and tail, that is not on its shaft's visible mask (H, W);
    NaN for an unknown axis."""
    if not np.isfinite(axis).all():
        return float("nan")
    along = np.linspace(0, 1, _AXIS_STEPS)[:, None]
    points = np.floor(axis[0] + along * (axis[1] - axis[0])).astype(int)
    columns, rows = np.clip(points, 0, np.array(mask.shape[::-1]) - 1).T
    return 1 - float(mask[rows, columns].mean())


def _groups(
    stated: NDArray[np.bool_], hidden: Array, crossed: NDArray[np.bool_]
) -> Mapping[str, NDArray[np.bool_]]:
    """Which shafts (G,) belong to each of `GROUPS`; stated: annotated as occluded."""
    occluded = stated | (hidden >= _OCCLUDED)
    return {
        "clear": ~occluded & ~crossed,
        "crossed": crossed,
        "occluded": occluded,
        "hidden": hidden >= _HIDDEN,
    }


def _crossed(shafts: Sequence[Mask], tools: Sequence[Mask]) -> NDArray[np.bool_]:
    """(G,) whether a shaft's mask meets that of another shaft, or of a tool that is not its own."""
    crossed = np.zeros(len(shafts), dtype=bool)
    for row, shaft in enumerate(shafts):
        near = _widened(shaft)
        others = [*shafts[:row], *shafts[row + 1 :], *(t for t in tools if not _part(shaft, t))]
        crossed[row] = any((near & other).any() for other in others)
    return crossed


def _part(shaft: Mask, tool: Mask) -> bool:
    return 2 * np.count_nonzero(shaft & tool) > np.count_nonzero(shaft)


def _widened(mask: Mask) -> Mask:
    """The mask with all pixels that are near enough to meet it."""
    reach = max(round(_MEETS * min(mask.shape)), 1)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), disc), bool)


def _union(masks: Sequence[Mask], size: tuple[int, int]) -> Mask:
    return np.any([np.zeros(size, dtype=bool), *masks], axis=0)
