import numpy as np
import pytest

from shaftpose.backgrounds.variations import VariationRanges, sample_variation, vary_colour


def pixel(*colour: int) -> np.ndarray:
    return np.array([[colour]], dtype=np.uint8)


def test_a_third_of_a_turn_makes_red_green() -> None:
    assert vary_colour(pixel(255, 0, 0), 120, 1, 1).tolist() == [[[0, 255, 0]]]


def test_a_negative_turn_goes_the_other_way() -> None:
    assert vary_colour(pixel(255, 0, 0), -120, 1, 1).tolist() == [[[0, 0, 255]]]


def test_no_saturation_gives_grey_of_the_same_value() -> None:
    assert vary_colour(pixel(200, 100, 40), 0, 0, 1).tolist() == [[[200, 200, 200]]]


def test_half_the_saturation_halves_the_distance_from_white() -> None:
    assert vary_colour(pixel(200, 100, 40), 0, 0.5, 1).tolist() == [[[200, 150, 120]]]


def test_half_the_brightness_halves_every_channel() -> None:
    assert vary_colour(pixel(200, 100, 40), 0, 1, 0.5).tolist() == [[[100, 50, 20]]]


def test_factors_saturate_instead_of_wrapping() -> None:
    assert vary_colour(pixel(200, 50, 0), 0, 3, 3).tolist() == [[[255, 64, 0]]]


def test_neutral_values_change_nothing() -> None:
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    assert np.array_equal(vary_colour(image, 0, 1, 1), image)


def test_small_turns_do_not_band() -> None:
    """A ramp of hues finer than OpenCV's 8-bit step of two degrees keeps its steps."""
    ramp = np.stack([np.full(60, 255), np.arange(60), np.zeros(60)], axis=-1)[None].astype(np.uint8)
    assert len(np.unique(vary_colour(ramp, 5, 1, 1), axis=1)[0]) == 60


@pytest.mark.parametrize("part", ["hue_deg", "saturation", "brightness"])
def test_samples_fill_their_range(part: str) -> None:
    ranges = VariationRanges(hue_deg=(-10, 10), saturation=(0.8, 1.2), brightness=(0.5, 1.5))
    rng = np.random.default_rng(1)
    values = np.array([getattr(sample_variation(rng, ranges), part) for _ in range(400)])
    low, high = getattr(ranges, part)
    assert values.min() >= low and values.max() <= high
    assert np.ptp(values) > 0.95 * (high - low)
