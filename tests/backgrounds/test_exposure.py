import numpy as np
import pytest

from shaftpose.backgrounds.exposure import add_highlights, develop, expose, linear

SIZE = 160
GREY = np.full((SIZE, SIZE, 3), 0.2, dtype=np.float32)
LEVEL = np.zeros((SIZE, SIZE), dtype=np.float32)


def test_exposure_makes_dark_and_bright_scenes_alike() -> None:
    dark, bright = (expose(GREY * np.float32(gain), 0.45) for gain in (0.1, 10))
    assert dark == pytest.approx(bright, abs=1e-5)
    assert expose(GREY, 0.55).mean() > 1.3 * expose(GREY, 0.45).mean()


def test_develop_undoes_linear() -> None:
    colour = np.array([200.0, 120.0, 90.0])
    picture = develop(np.random.default_rng(0), np.zeros_like(GREY) + linear(colour), LEVEL)
    assert picture.mean(axis=(0, 1)) == pytest.approx(colour, abs=1)


def test_a_highlight_saturates_and_blooms() -> None:
    shine = LEVEL.copy()
    shine[70:90, 70:90] = 2
    lit = add_highlights(GREY, shine)
    middle = develop(np.random.default_rng(0), lit, LEVEL)[74:86, 74:86]
    # Saturated up to sensor noise.
    assert np.mean(middle == 255) > 0.8 and middle.min() > 245
    assert np.all(lit[66, 70:90] > GREY[66, 70:90] + 0.02)
    assert lit[2, 2] == pytest.approx(GREY[2, 2], abs=1e-3)


def test_what_is_far_from_the_focus_is_soft() -> None:
    """The left half is one unit behind the right half, so one of them is out of focus."""
    stripes = GREY * (1 + np.float32(0.5) * (np.arange(SIZE) % 8 < 4)[:, None, None])
    height = LEVEL.copy()
    height[:, : SIZE // 2] = -1
    for seed in range(4):
        picture = develop(np.random.default_rng(seed), stripes, height).astype(float)
        contrast = sorted(half.std() for half in (picture[:, :70], picture[:, 90:]))
        assert contrast[0] < 0.95 * contrast[1]
