"""A model as a user without a camera loads it, and the shafts that it finds in whole frames."""

import hashlib
from collections.abc import Sequence

import cv2
import numpy as np

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Array, ShaftPose
from shaftpose.core.images import Image
from shaftpose.dataset.coco_images import CocoImage, Point, read_pixels
from shaftpose.inference.fields import Picture, VisibleField, visible_field
from shaftpose.inference.frame_views import views
from shaftpose.inference.loading import load
from shaftpose.inference.model_files import model_file
from shaftpose.inference.predictor import Predictor
from shaftpose.inference.views import View
from shaftpose.metrics.frames.comparison import FoundShafts
from shaftpose.metrics.image_metrics import Mask
from shaftpose.refinement.contour import Shaft
from shaftpose.refinement.outlines import contour_around

LEAST_SCORE = 0.01  # of the detections that average precision sees
_LEAST_TOOL = 0.5  # probability of a pixel of an instrument


class FrameModel:
    """A model for frames of unknown cameras; name: see `model_file`.

    sha256: of its file. threshold: its own confidence threshold.
    """

    def __init__(self, name: str) -> None:
        self._find = load(name, score=LEAST_SCORE, warn=_unsaid)
        with model_file(name) as path:
            self._predictor = Predictor(path)
            self.sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
        self.threshold = self._predictor.confidence
        metadata = self._predictor.metadata
        if metadata.shaft_diameter_mm is None or metadata.shaft_length_mm is None:
            raise InputError(f"{name}: knows an instrument from a CAD file; name a model of shafts")
        self._shaft = Shaft(
            metadata.shaft_diameter_mm, metadata.shaft_length_mm, metadata.shaft_tip == "flat"
        )
        model = self._predictor
        self._views = views(None, model.camera, model.frame_px, None, _unsaid)

    def __call__(self, image: CocoImage) -> FoundShafts:
        """The shafts in an image. Masks end at its visible field."""
        rgb = read_pixels(image)
        field = field_mask(rgb, image.field)
        view, found = self._views(image.width, image.height, 1.0), self._find(rgb)
        outlines = [outline_px(each.pose, self._shaft, view) for each in found]
        return FoundShafts(
            scores=np.array([each.score for each in found]),
            boxes=np.array([each.box for each in found]).reshape(-1, 4),
            masks=[field & convex_mask(outline, field.shape) for outline in outlines],
            axes=np.array([each.axis_px for each in found]).reshape(-1, 2, 2),
            tools=self._tools(rgb, view, field),
        )

    def _tools(self, rgb: Image, view: View, field: Mask) -> Mask | None:
        """All parts of instruments (H, W) in a frame; None if the model sees only a part of it, or
        does not say."""
        whole = self._predictor.frame_px is not None
        found = tool_mask(self._predictor, rgb, view) if whole else None
        return None if found is None else field & found


def _unsaid(warning: str) -> None:
    """Ignore a warning: that cameras and shafts are unknown is known here."""


def outline_px(pose: ShaftPose, shaft: Shaft, view: View) -> Array:
    """Points (N, 2) px of a shaft's outline in a frame, also beyond the frame's border."""
    return view.image_px(contour_around(pose.as_array(), shaft, view.camera))


def tool_mask(predictor: Predictor, rgb: Image, view: View) -> Mask | None:
    """The pixels (H, W) of any part of an instrument in a frame that a view shows whole; None if
    the model does not say. Black borders are skipped, as for shafts."""
    picture = Picture(view.picture(rgb), None, view.camera)
    height, width = picture.rgb.shape[:2]
    field = visible_field(picture.rgb) or VisibleField((0, 0, width, height))
    found = predictor.tools(picture.within(field).rgb[None])
    if found is None:
        return None
    x0, y0, x1, y1 = field.box
    whole = np.zeros((height, width), dtype=np.float32)
    whole[y0:y1, x0:x1] = found[0]
    return np.asarray(cv2.resize(whole, rgb.shape[1::-1]) > _LEAST_TOOL, bool)


def convex_mask(points: Array, size: tuple[int, ...]) -> Mask:
    """The pixels (H, W) whose centres are in the convex hull of points (N, 2) px."""
    rows, columns = (np.arange(count) + 0.5 for count in size)
    if not len(points):
        return np.zeros(size, dtype=bool)
    # OpenCV's filled polygons are half a pixel larger on every side.
    start = cv2.convexHull(points.astype(np.float32))[:, 0].astype(float)
    course = np.roll(start, 1, axis=0) - start
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (rows[:, None] - start[:, 1]) / course[:, 1]  # of an edge, where a row crosses it
    crossed = (share >= 0) & (share <= 1)
    at = start[:, 0] + np.where(crossed, share, 0.0) * course[:, 0]
    left = np.where(crossed, at, np.inf).min(axis=1)
    right = np.where(crossed, at, -np.inf).max(axis=1)
    return (columns > left[:, None]) & (columns < right[:, None])


def field_mask(rgb: Image, stated: Sequence[Point] | None) -> Mask:
    """The visible field (H, W) of a frame: the stated polygon, or else as the frame's brightness
    tells it, all of it in the dark."""
    if stated is not None:
        return convex_mask(np.array(stated), rgb.shape[:2])
    field = visible_field(rgb)
    if field is None:
        return np.ones(rgb.shape[:2], dtype=bool)
    x0, y0, x1, y1 = field.box
    y, x = np.indices(rgb.shape[:2]) + 0.5
    inside = (x > x0) & (x < x1) & (y > y0) & (y < y1)
    if field.disc is not None:
        inside &= field.disc.border_px(np.stack([x, y], axis=-1)) >= 0
    return inside
