"""Models loaded for a user's frames."""

import logging
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import get_args

from shaftpose.core.errors import InputError, Warn
from shaftpose.inference.calibration_files import FrameCamera, read_camera, stated_view
from shaftpose.inference.frame_views import ASSUMED_VIEW_DEG, Crop, views
from shaftpose.inference.model_files import DEFAULT, DIAMETERS_MM, model_file
from shaftpose.inference.predictor import Predictor
from shaftpose.inference.shaft_finder import ShaftFinder
from shaftpose.settings.choices import Backend, Refinement

log = logging.getLogger(__name__)

NO_OTHER_CAMERA = "was trained with lens distortion, which no other camera's frames can be given"


def load(
    model: Path | str | None = None,
    *,
    camera: Path | str | None = None,
    view_deg: float | None = None,
    diameter_mm: float | None = None,
    crop: Crop | None = None,
    score: float | None = None,
    refine: Refinement = "edges",
    backend: Backend = "onnxruntime",
    warn: Warn = log.warning,
) -> ShaftFinder:
    """Load a model that finds shafts in frames (H, W, 3) uint8 RGB of any size, with the options of
    `shaftpose predict`.

    model: see `model_file`; None: the default bundled model. camera: a calibration file of OpenCV
    or ROS. view_deg: instead of `camera`, the angle across a frame's central square, without
    distortion. diameter_mm: of the shafts. crop: x, y, width, height of the part of all frames to
    look at, px; the camera is then that of the part. score: least score of a detection; None: the
    model's own threshold. refine: see `settings.choices`. backend: the program that runs the model.
    warn: gets each warning once: of a camera or shafts that are unknown, and later of frames.
    Raises InputError naming the file or the option that cannot be used.
    """
    warn = cache(warn)  # once for each message
    _check(camera, view_deg, diameter_mm, score, crop)
    _check_choice("refine", refine, get_args(Refinement))
    _check_choice("backend", backend, get_args(Backend))
    with model_file(None if model is None else str(model)) as path:
        predictor = Predictor(path, refine, backend)
    if predictor.metadata.distorted and (camera is not None or view_deg is not None):
        raise InputError(
            f"{model or DEFAULT}: {NO_OTHER_CAMERA}: leave out --camera and --view-deg"
        )
    unknown = _unknown(predictor, camera is None and view_deg is None, diameter_mm is None)
    if unknown:
        warn(f"MILLIMETRES ARE NOT METRIC. {' '.join(unknown)}")
    if predictor.cannot_fit:
        warn(
            f"{model or DEFAULT}: poses are those of the network, less precise than fitted ones: "
            "models of an instrument from a CAD file or of a distorting lens cannot be fitted"
        )
    least = predictor.confidence if score is None else score
    frame_camera = _camera(None if camera is None else Path(camera), view_deg, warn)
    seen = views(frame_camera, predictor.camera, predictor.frame_px, crop, warn)
    by_angle = view_deg is not None
    return ShaftFinder(predictor, seen, least, diameter_mm, not unknown, by_angle, warn)


def _check(
    camera: Path | str | None,
    view_deg: float | None,
    diameter_mm: float | None,
    score: float | None,
    crop: Crop | None,
) -> None:
    """Raise InputError if an option has a meaningless value."""
    if camera is not None and view_deg is not None:
        raise InputError(f"camera {camera} and view_deg {view_deg:g}: give one of them")
    if view_deg is not None and not 0 < view_deg < 180:
        raise InputError(f"view_deg {view_deg:g}: give an angle between 0 and 180")
    least, most = DIAMETERS_MM
    if diameter_mm is not None and not least <= diameter_mm <= most:
        raise InputError(f"diameter_mm {diameter_mm:g}: give a number from {least:g} to {most:g}")
    if score is not None and not 0 <= score <= 1:
        raise InputError(f"score {score:g}: give a number from 0 to 1")
    if crop is not None and (len(crop) != 4 or min(crop[2:]) < 1):
        raise InputError(f"crop {crop}: give x, y, width and height, the last two above 0")


def _check_choice(option: str, value: str, choices: Sequence[str]) -> None:
    if value not in choices:
        raise InputError(f"{option} {value!r}: give one of {', '.join(choices)}")


def _unknown(predictor: Predictor, camera_unknown: bool, diameter_unknown: bool) -> list[str]:
    """Sentences about what the user has to state before millimetres are metric."""
    metadata, unknown = predictor.metadata, []
    if metadata.distorted:
        unknown.append(
            "The model was trained with lens distortion: its poses hold for that lens alone, "
            "which none of the options can state."
        )
    elif camera_unknown:
        assumed_deg = ASSUMED_VIEW_DEG if predictor.frame_px else metadata.view_deg
        unknown.append(
            f"A camera of {assumed_deg:g} deg is assumed: state yours (--camera or --view-deg)."
        )
    # An instrument from a CAD file has no diameter: the model knows no other instrument.
    if diameter_unknown and metadata.shaft_diameter_mm is not None:
        unknown.append(
            f"The model was trained for shafts of {metadata.shaft_diameter_mm:g} mm: state yours "
            "(--diameter-mm)."
        )
    return unknown


def _camera(calibration: Path | None, view_deg: float | None, warn: Warn) -> FrameCamera | None:
    """The user's camera; None if it is unknown."""
    if calibration is not None:
        return read_camera(calibration, warn)
    return None if view_deg is None else stated_view(view_deg)


@dataclass(frozen=True)
class FinderOptions:
    """Arguments of `load`, which can be sent to another process."""

    model: str | None
    camera: Path | None
    view_deg: float | None
    diameter_mm: float | None
    crop: Crop | None
    score: float | None
    refine: Refinement
    backend: Backend

    def finder(self, warn: Warn) -> ShaftFinder:
        """A finder with these options; see `load`."""
        return load(**asdict(self), warn=warn)
