from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.rendering.compositing import apply_lens, composite, to_srgb
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
    # A trace of foreground sends the pixel through the blend.
    foreground = np.zeros((16, 16, 4), dtype=np.float32)
    foreground[..., 3] = 1e-6
    np.testing.assert_array_equal(composite(foreground, background), background)


def test_without_foreground_the_bytes_are_kept() -> None:
    background = np.random.default_rng(1).integers(0, 256, (8, 9, 3)).astype(np.uint8)
    # Light without coverage (a stray filter weight) must not show either.
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
    # One standard deviation (2 px) beyond the edge 84 % of the step is reached.
    assert (seen[52] + seen[53]) / 2 == pytest.approx(40 + 0.8413 * 160, abs=4)


def test_the_sensor_seed_determines_smoke_and_noise() -> None:
    lens = Lens(blur_px=0.8, haze=0.3, vignette=0.4, noise=3.0)
    first, again, other = (apply_lens(flat(90), lens, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_the_given_image_is_left_alone() -> None:
    image = flat(90)
    apply_lens(image, Lens(blur_px=0.8, haze=0.3, vignette=0.4, noise=3.0), 1)
    assert np.all(image == 90)
