"""Frames with known shafts in the shapes of recorders: squares, 16:9, round, next to a panel."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Array, Camera, Disc
from shaftpose.core.images import Image
from shaftpose.core.shards import ShardedDataset

_WIDE_PX, _PANEL_GAP_PX = 1080, 40
_WORDS = ("PATIENT 0042", "12:41:07", "GAIN 3", "REC 00:17", "98 %")


@dataclass(frozen=True)
class AnnotatedFrame:
    """A frame (H, W, 3), its camera, and the poses (G, 5) and visible masks (G, H, W) of its
    shafts."""

    rgb: Image
    camera: Camera
    poses: Array
    masks: NDArray[np.bool_]

    @property
    def short_px(self) -> int:
        """The shorter side."""
        return min(self.camera.width, self.camera.height)

    @property
    def view_deg(self) -> float:
        """The true angle across the central square."""
        return float(np.degrees(2 * np.arctan(self.short_px / 2 / self.camera.focal_px)))


# A frame in another shape, from a rendered square and its number.
Reshape = Callable[[AnnotatedFrame, int], AnnotatedFrame]


def read_frame(shards: ShardedDataset, key: str) -> AnnotatedFrame:
    """A rendered square."""
    rgb, poses = shards.rgb(key), shards.annotations(key).poses
    assert poses is not None
    masks = np.reshape(shards.masks(key), (-1, *rgb.shape[:2])).astype(bool)
    return AnnotatedFrame(rgb, shards.camera(key), poses, masks)


def as_rendered(frame: AnnotatedFrame, _number: int) -> AnnotatedFrame:
    """The square itself."""
    return frame


def wide(frame: AnnotatedFrame, _number: int) -> AnnotatedFrame:
    """The middle rows of a square of 1911 px: a frame of 16:9, 1911 x 1080 px."""
    top, width = (frame.camera.height - _WIDE_PX) // 2, frame.camera.width
    rows = slice(top, top + _WIDE_PX)
    camera = frame.camera.cropped(0, top, width, _WIDE_PX)
    return AnnotatedFrame(frame.rgb[rows], camera, frame.poses, frame.masks[:, rows])


def _in_disc(
    frame: AnnotatedFrame, _number: int, x: float, y: float, size: float
) -> AnnotatedFrame:
    """A round picture, black outside; its centre and diameter in sides of the square."""
    side_px = frame.camera.width
    camera = replace(frame.camera, field=Disc(x * side_px, y * side_px, size * side_px))
    shown = np.isfinite(camera.rays()[..., 0])
    rgb = np.asarray(np.where(shown[..., None], frame.rgb, 0), np.uint8)
    return AnnotatedFrame(rgb, camera, frame.poses, frame.masks & shown)


inscribed_disc: Reshape = partial(_in_disc, x=0.5, y=0.5, size=1.0)
# Cut by three sides of the square.
larger_disc: Reshape = partial(_in_disc, x=0.53, y=0.48, size=1.08)


def _beside_panel(frame: AnnotatedFrame, number: int, disc: Reshape) -> AnnotatedFrame:
    """A round picture left in a black frame of 16:9, next to grey boxes with text."""
    picture = disc(frame, number)
    side = frame.camera.width
    width = 16 * side // 9
    rgb = np.zeros((side, width, 3), np.uint8)
    rgb[:, :side] = picture.rgb
    _draw_panel(rgb[:, side + _PANEL_GAP_PX : width - _PANEL_GAP_PX], number)
    masks = np.pad(picture.masks, ((0, 0), (0, 0), (0, width - side)))
    return AnnotatedFrame(rgb, picture.camera.cropped(0, 0, width, side), frame.poses, masks)


def _draw_panel(part: Image, number: int) -> None:
    """Draw boxes of random heights and greys, with text, into a part of a frame."""
    rng = np.random.default_rng(number)
    ends = np.cumsum(rng.dirichlet(np.full(len(_WORDS), 4.0)) * part.shape[0]).astype(int)
    for start, end, word in zip([0, *ends], ends, _WORDS, strict=False):
        part[start + _PANEL_GAP_PX : end] = rng.integers(40, 160)
        place, size = (_PANEL_GAP_PX, (start + end) // 2 + _PANEL_GAP_PX), part.shape[1] / 400
        cv2.putText(part, word, place, cv2.FONT_HERSHEY_SIMPLEX, size, (255, 255, 255), 2)


inscribed_disc_and_panel: Reshape = partial(_beside_panel, disc=inscribed_disc)
larger_disc_and_panel: Reshape = partial(_beside_panel, disc=larger_disc)
