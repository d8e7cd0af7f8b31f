from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.rendering.compositing import apply_lens, composite, darken, to_srgb
from shaftpose.rendering.scene import Lens

CLEAN = Lens(blur_px=0.0, haze=0.0, vignette=0.0, noise=0.0)


def flat(level: int, size: int = 101) -> NDArray[np.uint8]:
    return np.full((size, size, 3), level, dtype=np.uint8)


def pixel(red: float, green: float, blue: float, alpha: float) -> NDArray[np.float32]:
    return np.array([[[red, green, blue, alpha]]], dtype=np.float32)


@pytest.mark.parametrize(
    ("linear", "level"),
    [(0.0, 0), (0.0031308, 10), (0.01, 25), (0.5, 188), (1.0, 255), (7.0, 255), (-0.1, 0)],
)
def test_srgb_curve(linear: float, level: int) -> None:
    assert to_srgb(np.array([linear], dtype=np.float32)) == [level]


def test_every_level_survives_linear_light_and_back() -> None:
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    background = np.stack([levels] * 3, axis=-1)
    # Even a trace of foreground makes the pixel take part in the blend.
    foreground = np.zeros((16, 16, 4), dtype=np.float32)
    foreground[..., 3] = 1e-6
    np.testing.assert_array_equal(composite(foreground, background), background)


def test_without_foreground_the_bytes_are_kept() -> None:
    background = np.random.default_rng(1).integers(0, 256, (8, 9, 3)).astype(np.uint8)
    # Light without coverage (a stray filter weight) must not be visible either.
    foreground = np.full((8, 9, 4), 0.3, dtype=np.float32)
    foreground[..., 3] = 0
    np.testing.assert_array_equal(composite(foreground, background), background)


def test_full_foreground_replaces_the_background() -> None:
    for level in (0, 255):
        background = np.full((1, 1, 3), level, dtype=np.uint8)
        np.testing.assert_array_equal(
            composite(pixel(1.0, 0.5, 0.0, 1.0), background), [[[255, 188, 0]]]
        )


def test_half_foreground_blends_in_linear_light() -> None:
    # 0.25 + 0.5 * 1 = 0.75, which is 225 in sRGB (in sRGB values it would be 0.5 * (188 + 255)).
    white = np.full((1, 1, 3), 255, dtype=np.uint8)
    np.testing.assert_array_equal(composite(pixel(0.25, 0.0, 0.5, 0.5), white), [[[225, 188, 255]]])


def test_light_is_taken_away_in_linear_light() -> None:
    levels = np.arange(256, dtype=np.uint8).reshape(1, 256, 1).repeat(3, axis=2)
    none, half = (np.full((1, 256), share, dtype=np.float32) for share in (0, 0.5))
    np.testing.assert_array_equal(darken(levels, none), levels)
    assert darken(levels, half)[0, 255].tolist() == [188] * 3  # half of the light of 255


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
