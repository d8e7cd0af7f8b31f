"""The lens: its geometry, against rays, and its effects on an image."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.rendering.optics import (
    apply_lens,
    camera_with,
    middle_camera,
    pinhole_behind,
    seen_by,
)
from shaftpose.rendering.scene import Lens
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
    expected = replace(camera, k1=pytest.approx(-0.15), k2=0.05, field=camera.disc(280.0))
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


# Effects on the finished image.

CLEAN = Lens(blur_px=0.0, haze=0.0, vignette=0.0, noise=0.0)


def flat(level: int, size: int = 101) -> NDArray[np.uint8]:
    return np.full((size, size, 3), level, dtype=np.uint8)


def test_a_clean_lens_changes_nothing() -> None:
    image = np.random.default_rng(2).integers(0, 256, (20, 20, 3)).astype(np.uint8)
    np.testing.assert_array_equal(apply_lens(image, CLEAN, 1), image)


def test_vignette_darkens_the_corners_only() -> None:
    seen = apply_lens(flat(200), replace(CLEAN, vignette=0.5), 1)
    assert np.all(seen[50, 50] == 200)
    for corner in (seen[0, 0], seen[0, -1], seen[-1, 0], seen[-1, -1]):
        assert np.all(corner == 100)


def test_haze_brightens_a_dark_image() -> None:
    thin, thick = (apply_lens(flat(20), replace(CLEAN, haze=h), 1).mean() for h in (0.2, 0.6))
    assert 20 < thin < thick < 214
    full = apply_lens(flat(20), replace(CLEAN, haze=1.0), 1)
    assert full.max() <= 214


def test_noise_has_the_set_strength() -> None:
    seen = apply_lens(flat(128), replace(CLEAN, noise=5.0), 1).astype(float)
    assert seen.std() == pytest.approx(5.0, rel=0.05)
    assert seen.mean() == pytest.approx(128, abs=0.2)


def test_blur_spreads_an_edge_and_keeps_its_place() -> None:
    image = flat(40)
    image[:, 51:] = 200
    seen = apply_lens(image, replace(CLEAN, blur_px=2.0), 1)[50, :, 0].astype(int)
    assert np.all(np.diff(seen) >= 0)
    assert 40 < seen[49] < seen[50] < 120 < seen[51] < seen[52] < 200
    # 84 % of the step is reached one standard deviation (2 px) beyond the edge.
    assert (seen[52] + seen[53]) / 2 == pytest.approx(40 + 0.8413 * 160, abs=4)


def test_motion_spreads_a_point_along_its_way() -> None:
    image = flat(0)
    image[50, 50] = 250
    seen = apply_lens(image, replace(CLEAN, motion_px=(6.0, 0.0)), 1)[..., 0].astype(int)
    # 250 over a path of 6 px: 41 or 42 on each of 5 px, half of that on the two at the ends.
    assert np.count_nonzero(seen[:50]) == np.count_nonzero(seen[51:]) == 0
    assert np.all(np.abs(seen[50, 48:53] - 250 / 6) <= 2)
    assert seen[50, 47] == pytest.approx(21, abs=2)
    np.testing.assert_array_equal(seen[50], seen[50, ::-1])
    assert seen.sum() == pytest.approx(250, abs=8)
    np.testing.assert_array_equal(
        apply_lens(image, replace(CLEAN, motion_px=(0.0, 6.0)), 1)[..., 0].T, seen
    )


def test_motion_may_be_oblique_and_moves_nothing_on_the_whole() -> None:
    image = flat(0)
    image[50, 50] = 255
    seen = apply_lens(image, replace(CLEAN, motion_px=(-5.0, 8.0)), 1)[..., 0].astype(float)
    rows, columns = np.nonzero(seen > 8)
    assert np.ptp(rows) == pytest.approx(8, abs=1)
    assert np.ptp(columns) == pytest.approx(5, abs=1)
    assert np.corrcoef(rows, columns)[0, 1] < -0.9
    v, u = np.mgrid[0:101, 0:101]
    assert (seen * u).sum() / seen.sum() == pytest.approx(50, abs=0.1)
    assert (seen * v).sum() / seen.sum() == pytest.approx(50, abs=0.1)


def test_what_the_lens_does_not_show_is_black_but_for_noise() -> None:
    shown = np.zeros((101, 101), dtype=bool)
    shown[30:60, 30:60] = True
    hazy = replace(CLEAN, haze=0.5, blur_px=2.0)
    for lens in (CLEAN, hazy):
        seen = apply_lens(flat(120), lens, 1, shown)
        assert not seen[~shown].any()
        assert seen[shown].min() > 60
    noisy = apply_lens(flat(120), replace(CLEAN, noise=4.0), 1, shown)
    assert 0 < noisy[~shown].mean() < 5


def test_a_recorder_compresses_the_noise_away() -> None:
    lens = replace(CLEAN, noise=4.0)
    raw, good, bad = (
        apply_lens(flat(128), replace(lens, jpeg_quality=quality), 1) for quality in (None, 95, 20)
    )
    errors = [np.abs(image.astype(int) - raw).mean() for image in (good, bad)]
    assert 0 < errors[0] < errors[1]
    assert bad.std() < 0.8 * raw.std()


def test_the_sensor_seed_determines_smoke_and_noise() -> None:
    lens = Lens(blur_px=0.8, haze=0.3, vignette=0.4, noise=3.0)
    first, again, other = (apply_lens(flat(90), lens, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_the_given_image_is_left_alone() -> None:
    image = flat(90)
    apply_lens(image, Lens(blur_px=0.8, haze=0.3, vignette=0.4, noise=3.0), 1)
    assert np.all(image == 90)
