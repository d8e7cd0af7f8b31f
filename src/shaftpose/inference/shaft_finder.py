"""Finds shafts in frames of any size, with poses for the user's camera and shaft."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from shaftpose.core.errors import InputError, Warn
from shaftpose.core.geometry import Array, Camera, ShaftPose
from shaftpose.core.images import Image
from shaftpose.core.instruments import Detections
from shaftpose.inference.fields import LEAST_LEVEL, Picture, VisibleField, visible_field
from shaftpose.inference.found_shafts import FoundShaft, axis_px, box_px
from shaftpose.inference.frame_views import Views
from shaftpose.inference.predictor import Predictor
from shaftpose.inference.views import View
from shaftpose.refinement.refiner import FittedDetections, TipState, tip_state

_LONGEST_PX = 32_766  # OpenCV can neither resample nor store longer images
_LEAST_FILLED = 0.9  # of a side of the frame's central square, by that of the picture in it
_MOST_ASIDE = 0.1  # of that side, from the frame's centre to the picture's


class ShaftFinder:
    """Finds shafts in a user's frames.

    views: of the frames. score: least score of a detection. diameter_mm: of the user's shafts;
    None: the model's. metric: whether camera and shaft are known. by_angle: whether the camera is
    known by its angle alone. warn: gets warnings of frames that show nothing, or a picture that the
    angle may not be of. Raises InputError if `diameter_mm` is given and the model states no
    diameter.
    """

    def __init__(
        self,
        predictor: Predictor,
        views: Views,
        score: float,
        diameter_mm: float | None,
        metric: bool,
        by_angle: bool,
        warn: Warn,
    ) -> None:
        self._predictor, self._views, self._score = predictor, views, score
        self._scale = _scale(predictor.metadata.shaft_diameter_mm, diameter_mm)
        self._metric, self._by_angle, self._warn = metric, by_angle, warn
        self.diameter_mm = diameter_mm or predictor.metadata.shaft_diameter_mm  # None: a CAD file's

    def __call__(
        self, rgb: Image, source: str = "a frame", aspect: float = 1.0
    ) -> list[FoundShaft]:
        """The shafts in a frame (H, W, 3) uint8 RGB, best score first.

        source: its name in warnings. aspect: width / height of its pixels, which a calibrated
        camera knows by itself. Raises InputError if the frame has another shape or type, does not
        fit the user's camera, or is too large.
        """
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
            raise InputError(
                f"is an array {rgb.shape} of {rgb.dtype}; give height x width x 3 of uint8, RGB"
            )
        height, width = rgb.shape[:2]
        if max(height, width) > _LONGEST_PX:
            raise InputError(
                f"has {width} x {height} px; scale it to at most {_LONGEST_PX:,} px a side"
            )
        view = self._views(width, height, aspect)
        fine = view.fine_picture(rgb) if self._predictor.fits_edges else None
        picture, corner = Picture(view.picture(rgb), fine, view.camera), np.zeros(2)
        field = visible_field(picture.rgb)
        if field is None:
            lit = "all black" if rgb.max() < LEAST_LEVEL else "dark in more than 95 % of it"
            self._warn(f"{source}: a frame of {width} x {height} px is {lit}")
        if self._predictor.frame_px is not None:
            if field is None:
                return []
            if self._by_angle and _is_bordered(field, picture.camera):
                self._warn(
                    f"frames of {width} x {height} px have black borders or dark margins: "
                    "--view-deg is the angle across the central square of all that is used of a "
                    "frame; if yours is that of the picture alone, cut it out by --crop"
                )
            picture, corner = picture.within(field), np.array(field.box[:2])
        (every,) = self._predictor(picture.rgb[None], [picture.fine], picture.camera)
        found = every.above(self._score)
        boxes = [box_px(box + np.tile(corner, 2), view, width, height) for box in found.boxes]
        deviations, tips = self._doubts(found, picture.camera)
        rows = zip(found.scores.tolist(), boxes, found.poses, deviations, tips, strict=True)
        return [self._in_frame(view, *row) for row in rows]

    def _doubts(
        self, found: Detections, camera: Camera
    ) -> tuple[Sequence[Array | None], Sequence[TipState]]:
        """The deviations of poses, where they were fitted, and the states of their tips."""
        if not isinstance(found, FittedDetections):
            tips = [tip_state(pose, camera) for pose in found.poses]
            return [None] * len(tips), tips
        scale = np.array([self._scale] * 3 + [1.0] * 2)
        deviations = [scale * own if np.isfinite(own).all() else None for own in found.deviations]
        return deviations, found.tips.tolist()

    def axis_px(self, pose: ShaftPose, rgb: Image, aspect: float = 1.0) -> Array:
        """Project a pose's tip and axis into a frame (H, W, 3): (2, 2) px, see `FoundShaft`."""
        height, width = rgb.shape[:2]
        return axis_px(pose, self._views(width, height, aspect))

    def camera_matrix(self, rgb: Image, aspect: float = 1.0) -> Array:
        """The intrinsic matrix (3, 3) of a frame (H, W, 3), without its lens distortion; from the
        assumed camera if the frame's is unknown."""
        height, width = rgb.shape[:2]
        return self._views(width, height, aspect).frame_matrix

    def _in_frame(
        self,
        view: View,
        score: float,
        box: Array,
        values: Array,
        deviations: Array | None,
        tip: TipState,
    ) -> FoundShaft:
        pose = self._scaled(ShaftPose.from_array(values))
        axis = axis_px(pose, view)
        return FoundShaft(score, box, axis, pose, self._metric, tip, deviations)

    def _scaled(self, pose: ShaftPose) -> ShaftPose:
        """Scale a pose to the user's shafts: a scene enlarged as a whole gives the same image."""
        x_mm, y_mm, z_mm = (float(value) for value in self._scale * pose.tip_mm)
        return replace(pose, x_mm=x_mm, y_mm=y_mm, z_mm=z_mm)


def _is_bordered(field: VisibleField, camera: Camera) -> bool:
    """Whether the central square of a field is smaller than that of the image, or beside it."""
    x0, y0, x1, y1 = field.box
    disc, side = field.disc, min(camera.width, camera.height)
    centre = np.array([(x0 + x1) / 2, (y0 + y1) / 2] if disc is None else [disc.x, disc.y])
    aside = np.abs(centre - np.array([camera.width, camera.height]) / 2).max()
    return bool(min(x1 - x0, y1 - y0) < _LEAST_FILLED * side or aside > _MOST_ASIDE * side)


def _scale(model_mm: float | None, diameter_mm: float | None) -> float:
    if diameter_mm is None:
        return 1.0
    if model_mm is None:
        raise InputError(
            f"--diameter-mm {diameter_mm:g}: the model states no diameter of its own; leave it out"
        )
    return diameter_mm / model_mm
