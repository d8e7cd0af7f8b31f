import numpy as np
import pytest

from shaftpose.backgrounds.noise import pixel_grid
from shaftpose.backgrounds.relief import VIEW
from shaftpose.backgrounds.scope import (
    add_highlights,
    develop,
    expose,
    linear,
    normals,
    openness,
    scope_light,
)

SIZE = 64


def plane(depth: float) -> np.ndarray:
    """Heights of a flat wall facing the camera."""
    return np.full((SIZE, SIZE), -np.log(depth) / VIEW, dtype=np.float32)


def test_a_tilted_plane_has_one_normal() -> None:
    """On the ray (u, v, 1) the plane a X + b Y + c Z = 1 has the depth 1 / (a u + b v + c)."""
    a, b, c = 0.3, -0.2, 0.8
    x, y = pixel_grid(SIZE)
    height = np.log(a * VIEW * x + b * VIEW * y + c) / VIEW
    expected = np.array([-a, -b, c]) / np.linalg.norm([a, b, c])
    # np.gradient is one-sided on the border.
    assert normals(height)[1:-1, 1:-1] == pytest.approx(
        np.broadcast_to(expected, (SIZE - 2, SIZE - 2, 3)), abs=2e-3
    )


def test_light_falls_with_the_square_of_the_distance() -> None:
    near, far = (
        scope_light(np.random.default_rng(0), plane(depth), 0.01)[0][SIZE // 2, SIZE // 2]
        for depth in (1.0, 3.0)
    )
    assert near / far == pytest.approx(9, rel=0.1)


def test_a_slope_away_from_the_lamp_is_darker() -> None:
    x, _ = pixel_grid(SIZE)
    ridge = np.float32(0.2) * np.exp(-((x / 0.05) ** 2))
    light, _ = scope_light(np.random.default_rng(0), ridge, 0.01)
    flank = np.abs(np.abs(x[0]) - 0.035).argmin()
    assert light[:, flank].mean() < 0.8 * light[:, SIZE // 8].mean()


def test_the_share_of_highlights_is_as_asked() -> None:
    rng = np.random.default_rng(2)
    height = (0.01 * rng.standard_normal((SIZE, SIZE))).astype(np.float32)
    for share in (0.01, 0.1):
        _, shine = scope_light(np.random.default_rng(3), height, share)
        # Counted on every other pixel; the sheen adds a little.
        assert 0.5 * share < np.mean(shine >= 1) < 2.5 * share


def test_a_crease_is_darker_than_a_flat_place() -> None:
    x, _ = pixel_grid(SIZE)
    crease = -np.float32(0.1) * np.exp(-((x / 0.03) ** 2))
    opened = openness(crease)
    assert opened[:, SIZE // 2].max() < 0.9 * opened[:, 2].min()
    assert openness(plane(1.0)) == pytest.approx(np.ones((SIZE, SIZE)), abs=1e-5)


# The camera.

CAMERA_SIZE = 160
GREY = np.full((CAMERA_SIZE, CAMERA_SIZE, 3), 0.2, dtype=np.float32)
LEVEL = np.zeros((CAMERA_SIZE, CAMERA_SIZE), dtype=np.float32)


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
    stripes = GREY * (1 + np.float32(0.5) * (np.arange(CAMERA_SIZE) % 8 < 4)[:, None, None])
    height = LEVEL.copy()
    height[:, : CAMERA_SIZE // 2] = -1
    for seed in range(4):
        picture = develop(np.random.default_rng(seed), stripes, height).astype(float)
        contrast = sorted(half.std() for half in (picture[:, :70], picture[:, 90:]))
        assert contrast[0] < 0.95 * contrast[1]
