"""Colour changes against hand-computed values, and the paper's noise."""

import numpy as np
import pytest

from shaftpose.dataset.colour_transforms import ColourJitter, UniformNoise, colour_matrix

RED = np.array([200.0, 40.0, 30.0])


def apply(matrix: np.ndarray, rgb: np.ndarray) -> np.ndarray:
    return matrix @ np.append(rgb, 1.0)


def image(seed: int, size: int = 24) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (size, size, 3), dtype=np.uint8)


def grey(level: int, size: int = 24) -> np.ndarray:
    return np.full((size, size, 3), level, dtype=np.uint8)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("hue_deg", [0.0, 360.0, -360.0])
def test_no_change_is_the_identity(hue_deg: float) -> None:
    matrix = colour_matrix(brightness=0, contrast=1, saturation=1, hue_deg=hue_deg)
    np.testing.assert_allclose(matrix, np.eye(3, 4), atol=1e-12)


def test_without_saturation_remains_the_luma() -> None:
    matrix = colour_matrix(brightness=0, contrast=1, saturation=0, hue_deg=33)
    # NTSC: 0.299 * 200 + 0.587 * 40 + 0.114 * 30 = 59.8 + 23.48 + 3.42 = 86.7.
    # The published YIQ matrix is rounded to four digits: its I and Q rows each sum to 0.
    np.testing.assert_allclose(apply(matrix, RED), [86.7] * 3, atol=0.05)


def test_hue_keeps_greys_and_the_luma() -> None:
    matrix = colour_matrix(brightness=0, contrast=1, saturation=1, hue_deg=120)
    np.testing.assert_allclose(apply(matrix, np.full(3, 90.0)), [90.0] * 3, atol=0.05)
    turned = apply(matrix, RED)
    assert turned @ [0.299, 0.587, 0.114] == pytest.approx(86.7, abs=1e-6)
    assert np.abs(turned - RED).max() > 50


def test_hue_turns_add_up() -> None:
    third = colour_matrix(0, 1, 1, 120)[:, :3]
    np.testing.assert_allclose(third @ third @ third, np.eye(3), atol=1e-12)


def test_saturation_scales_the_distance_from_the_luma() -> None:
    matrix = colour_matrix(brightness=0, contrast=1, saturation=0.5, hue_deg=0)
    # Halfway between the colour and its luma of 86.7: (143.35, 63.35, 58.35).
    np.testing.assert_allclose(apply(matrix, RED), [143.35, 63.35, 58.35], atol=0.05)


def test_contrast_and_brightness_by_hand() -> None:
    matrix = colour_matrix(brightness=10, contrast=2, saturation=1, hue_deg=0)
    # 128 + 2 (v - 128) + 10 of 200, 40, 30: 282, -38, -58.
    np.testing.assert_allclose(apply(matrix, RED), [282, -38, -58], atol=1e-9)


def test_jitter_applies_the_matrix_and_clips() -> None:
    # Single-value ranges: brightness 10, contrast 2.
    jitter = ColourJitter((10, 10), (2, 2), (1, 1), (0, 0))
    pixels = np.array([[[200, 40, 100], [128, 69, 186]]], dtype=np.uint8)
    # 282 -> 255, -38 -> 0, 82; 138, 20, 254.
    np.testing.assert_array_equal(jitter(pixels, rng()), [[[255, 0, 82], [138, 20, 254]]])


def test_jitter_draws_from_its_ranges() -> None:
    jitter = ColourJitter((-20, 20), (1, 1), (1, 1), (0, 0))
    generator = rng(1)
    levels = {int(jitter(grey(100, 2), generator)[0, 0, 0]) for _ in range(200)}
    assert min(levels) >= 80
    assert max(levels) <= 120
    assert len(levels) > 20


def test_neutral_jitter_leaves_the_image() -> None:
    jitter = ColourJitter((0, 0), (1, 1), (1, 1), (0, 0))
    np.testing.assert_array_equal(jitter(image(0), rng()), image(0))


def test_noise_stays_in_its_bounds_and_reaches_both() -> None:
    noise = UniformNoise(half_width=10, probability=1.0)
    changes = noise(grey(128), rng()).astype(int) - 128
    # 24 * 24 * 3 = 1728 draws of 21 values: each occurs about 82 times.
    values, counts = np.unique(changes, return_counts=True)
    np.testing.assert_array_equal(values, np.arange(-10, 11))
    assert counts.min() > 40
    # Channels are drawn independently.
    assert np.any(changes[..., 0] != changes[..., 1])


def test_half_of_the_images_get_noise() -> None:
    generator = rng(2)
    noise = UniformNoise(half_width=10)
    same = sum(np.array_equal(noise(grey(128, 8), generator), grey(128, 8)) for _ in range(200))
    # 100 expected; within two standard deviations of sqrt(200 / 4) = 7.1.
    assert abs(same - 100) <= 14


def test_noise_is_clipped_at_black_and_white() -> None:
    noise = UniformNoise(half_width=10, probability=1.0)
    black, white = noise(grey(0), rng()), noise(grey(255), rng())
    assert (black.min(), black.max()) == (0, 10)
    assert (white.min(), white.max()) == (245, 255)
    # 11 of 21 draws are not above 0.
    assert np.mean(black == 0) == pytest.approx(11 / 21, abs=0.05)


@pytest.mark.parametrize(
    "transform",
    [UniformNoise(10, 1.0), ColourJitter((-32, 32), (0.75, 1.25), (0.75, 1.25), (-10, 10))],
)
def test_the_generator_decides(transform: UniformNoise | ColourJitter) -> None:
    before = image(5)
    given = before.copy()
    first = transform(given, rng(1))
    assert first.dtype == np.uint8
    assert first.shape == before.shape
    np.testing.assert_array_equal(given, before)  # the input is unchanged
    np.testing.assert_array_equal(transform(given, rng(1)), first)
    assert not np.array_equal(transform(given, rng(2)), first)
