"""Lens effects on a pinhole's image, against pure geometry."""

from dataclasses import replace

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose, cylinder_depth
from shaftpose.rendering.optics import camera_with, middle_camera, pinhole_behind, seen_by
from shaftpose.settings.schema import Distortion, RenderSettings

SIZE_MM = 3.0, 150.0
POSES = [
    ShaftPose(-15.0, -12.0, 20.0, 60.0, 150.0),
    ShaftPose(8.0, 15.0, 25.0, 75.0, 30.0),
    ShaftPose(0.0, 0.0, 30.0, 85.0, 300.0),
]


def with_lens(
    settings: RenderSettings,
    k1: tuple[float, float] = (0.0, 0.0),
    k2: tuple[float, float] = (0.0, 0.0),
    field_px: float | None = None,
) -> RenderSettings:
    lens = replace(settings.lens, distortion=Distortion(k1, k2), field_px=field_px)
    return replace(settings, lens=lens)


def test_without_a_lens_all_cameras_are_the_pinhole(
    settings: RenderSettings, camera: Camera
) -> None:
    assert camera_with(settings, 0.0, 0.0) == camera
    assert middle_camera(settings) == camera
    assert pinhole_behind(settings) == camera


def test_the_middle_camera(settings: RenderSettings, camera: Camera) -> None:
    ranges = with_lens(settings, (-0.2, -0.1), (0.0, 0.1), 280.0)
    expected = replace(camera, k1=pytest.approx(-0.15), k2=0.05, field_px=280.0)
    assert middle_camera(ranges) == expected


@pytest.mark.parametrize("field_px", [None, 250.0])
def test_the_pinhole_holds_all_that_any_camera_of_the_set_sees(
    settings: RenderSettings, camera: Camera, field_px: float | None
) -> None:
    ranges = with_lens(settings, (-0.2, 0.1), (0.05, 0.08), field_px)
    pinhole = pinhole_behind(ranges)
    assert pinhole.focal_px == camera.focal_px
    assert (pinhole.cx, pinhole.cy) == (pinhole.width / 2, pinhole.height / 2)
    farthest = []
    for k1 in (-0.2, 0.1):
        for k2 in (0.05, 0.08):
            rays = camera_with(ranges, k1, k2).rays()
            pixels = pinhole.project(rays[np.isfinite(rays[..., 0])])
            assert pixels.min() >= 0.49
            assert pixels.max() <= pinhole.width - 0.49
            farthest.append(pixels.max())
    assert max(farthest) > pinhole.width - 1.51  # and no larger than needed


def test_pincushion_distortion_needs_no_margin(settings: RenderSettings, camera: Camera) -> None:
    assert pinhole_behind(with_lens(settings, (0.0, 0.2))) == camera


def test_a_distortion_that_leaves_corners_empty_is_refused(settings: RenderSettings) -> None:
    with pytest.raises(InputError, match=r"lens\.distortion: k1 = -0\.1 with k2 = 0 ") as caught:
        pinhole_behind(with_lens(settings, (-0.1, 0.0)))
    assert "\n" not in str(caught.value)
    # A circular field of view hides the corners.
    pinhole_behind(with_lens(settings, (-0.1, 0.0), field_px=290.0))


@pytest.mark.parametrize(
    ("k1", "k2", "field_px"), [(-0.2, 0.05, None), (0.15, 0.0, None), (-0.2, 0.05, 260.0)]
)
def test_masks_and_colours_are_where_the_camera_sees_them(
    settings: RenderSettings, k1: float, k2: float, field_px: float | None
) -> None:
    """A silhouette mapped from the pinhole's image against one by the camera's own rays."""
    ranges = with_lens(settings, (k1, k1), (k2, k2), field_px)
    camera, pinhole = camera_with(ranges, k1, k2), pinhole_behind(ranges)
    for pose in POSES:
        index = np.isfinite(cylinder_depth(pinhole, pose, *SIZE_MM)).astype(np.int64)
        linear = np.repeat(index[..., None], 4, axis=-1).astype(np.float32)
        colours, objects = seen_by(camera, pinhole, linear, index)
        expected = np.isfinite(cylinder_depth(camera, pose, *SIZE_MM))
        assert colours.shape == (299, 299, 4)
        for found in (objects == 1, colours[..., 3] > 0.5):
            assert (found & expected).sum() / (found | expected).sum() > 0.97
        if field_px is not None:
            shown = np.isfinite(camera.rays()[..., 0])
            assert not objects[~shown].any()
            assert not colours[~shown].any()


def test_a_camera_equal_to_the_pinhole_changes_nothing(camera: Camera) -> None:
    rng = np.random.default_rng(4)
    linear = rng.random((299, 299, 4), dtype=np.float32)
    index = rng.integers(0, 4, (299, 299))
    colours, objects = seen_by(camera, camera, linear, index)
    np.testing.assert_array_equal(objects, index)
    np.testing.assert_allclose(colours, linear, atol=1e-6)
