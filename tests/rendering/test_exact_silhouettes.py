"""Rendered masks over the whole range of poses, against a cylinder computed here.

Independent of `core.geometry`, which computes amodal masks: a ray is intersected with the slab
between the cylinder's ends and with the infinite cylinder, by the distance between two lines.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.rendering.poses import PoseSampler
from shaftpose.settings.schema import RenderSettings
from tests.rendering.blender_process import run_python

POSES = 200
LEAST_IOU = 0.99

RENDER_SINGLES = """
import numpy as np
from shaftpose.rendering.optics import middle_camera
from shaftpose.rendering.silhouette import SilhouetteRenderer
render, camera = SilhouetteRenderer(settings), middle_camera(settings)
masks = [render(np.array([pose], dtype=float), camera)[0] for pose in poses]
np.save("masks.npy", np.packbits(masks, axis=-1))
"""


def cylinder_mask(pose: ShaftPose, settings: RenderSettings) -> NDArray[np.bool_]:
    """Mask (size, size) of pixels whose rays hit the cylinder in front of the camera."""
    size, view = settings.camera.size_px, np.radians(settings.camera.view_deg)
    centres = (np.arange(size) + 0.5 - size / 2) * 2 * np.tan(view / 2) / size
    rays = np.stack([*np.meshgrid(centres, centres), np.ones((size, size))], axis=-1)
    pitch, yaw = np.radians(pose.pitch_deg), np.radians(pose.yaw_deg)
    axis = np.array([np.sin(pitch) * np.cos(yaw), np.sin(pitch) * np.sin(yaw), -np.cos(pitch)])
    tip, radius = np.array([pose.x_mm, pose.y_mm, pose.z_mm]), settings.shaft.diameter_mm / 2
    normal = np.cross(rays, axis)
    steep = np.linalg.norm(normal, axis=-1)  # ray's length x sine of its angle to the axis
    distance = np.abs(normal @ tip) / steep
    nearest = np.sum(normal * np.cross(tip, axis), axis=-1) / steep**2
    with np.errstate(invalid="ignore"):
        half = np.sqrt(radius**2 - distance**2) / steep
    ends = (np.array([0, settings.shaft.length_mm])[:, None, None] + tip @ axis) / (rays @ axis)
    enter = np.maximum(nearest - half, np.maximum(ends.min(axis=0), 0))
    leave = np.minimum(nearest + half, ends.max(axis=0))
    return np.asarray(enter < leave)  # False where half is NaN: the ray misses


def iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return float((a & b).sum() / (a | b).sum())


@pytest.fixture(scope="module")
def poses(camera: Camera, settings: RenderSettings) -> list[ShaftPose]:
    draw = PoseSampler(camera, settings.poses, settings.shaft, settings.scene)
    rng = np.random.default_rng(41)
    return [draw(rng, 1).poses[0] for _ in range(POSES)]


@pytest.fixture(scope="module")
def masks(
    poses: list[ShaftPose], settings: RenderSettings, tmp_path_factory: pytest.TempPathFactory
) -> NDArray[np.bool_]:
    """Masks (POSES, size, size), rendered by one process."""
    folder: Path = tmp_path_factory.mktemp("masks")
    arrays = [pose.as_array().tolist() for pose in poses]
    run_python(RENDER_SINGLES, folder, settings, poses=arrays)
    packed = np.load(folder / "masks.npy")
    return np.unpackbits(packed, axis=-1, count=settings.camera.size_px).astype(bool)


def test_the_poses_span_their_ranges(poses: list[ShaftPose], settings: RenderSettings) -> None:
    drawn = np.array([pose.as_array() for pose in poses])
    low, high = np.array(settings.poses.low), np.array(settings.poses.high)
    assert np.all(np.ptp(drawn, axis=0) > 0.9 * (high - low))


def test_every_mask_equals_the_exact_cylinder(
    masks: NDArray[np.bool_], poses: list[ShaftPose], settings: RenderSettings
) -> None:
    found = [iou(m, cylinder_mask(p, settings)) for m, p in zip(masks, poses, strict=True)]
    worst = int(np.argmin(found))
    assert found[worst] >= LEAST_IOU, f"IoU {found[worst]:.4f} at {poses[worst]}"


def test_a_shaft_thicker_by_a_tenth_of_a_millimetre_would_fail(
    masks: NDArray[np.bool_], poses: list[ShaftPose], settings: RenderSettings
) -> None:
    shaft = replace(settings.shaft, diameter_mm=settings.shaft.diameter_mm + 0.1)
    thick = replace(settings, shaft=shaft)
    found = [iou(m, cylinder_mask(p, thick)) for m, p in zip(masks, poses, strict=True)]
    assert max(found) < LEAST_IOU
