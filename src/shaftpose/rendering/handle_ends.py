"""A warning of shafts that end inside the image, where real ones lead to a robot or a hand."""

import logging

import numpy as np

from shaftpose.core.geometry import Camera
from shaftpose.rendering.poses import PoseSampler
from shaftpose.settings.schema import RenderSettings

_DRAWS = 300


def warn_of_visible_ends(settings: RenderSettings) -> None:
    """Log a warning if some poses, drawn as those of scenes, show the far end of the shaft.

    Instruments from a CAD file are not checked: they may be of anything.
    """
    if settings.shaft.cad:
        return
    side = settings.camera.size_px
    camera = Camera.from_field_of_view(side, side, settings.camera.view_deg)
    draw = PoseSampler(camera, settings.poses, settings.shaft, settings.scene)
    rng = np.random.default_rng(0)
    poses = [pose for _ in range(_DRAWS) for pose in draw(rng, 1).poses]
    ends = np.array([pose.tip_mm + settings.shaft.length_mm * pose.direction for pose in poses])
    ends = ends[ends[:, 2] > 0]  # in front of the camera
    count = int(camera.shows(camera.project(ends)).sum())
    if count:
        logging.getLogger(__name__).warning(
            "%d of %d shafts end inside the image: make shaft.length_mm larger, or the upper ends "
            "of poses.z_mm and pitch_deg smaller",
            count, len(poses),
        )  # fmt: skip
