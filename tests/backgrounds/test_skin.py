import numpy as np
import pytest

from shaftpose.backgrounds.noise import Field, lobules, pixel_grid
from shaftpose.backgrounds.skin import Skin, fill_hollows, make_skin, palette
from shaftpose.backgrounds.tissue import MUCOSA
from shaftpose.backgrounds.vessels import vessel_trees

SIZE = 96


def bowl() -> Field:
    x, y = pixel_grid(SIZE)
    return -np.float32(0.3) * np.exp(-(x**2 + y**2) / np.float32(0.02))


@pytest.mark.parametrize("seed", range(3))
def test_skin_is_a_colour_with_small_bumps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    skin = make_skin(rng, SIZE, palette(rng, MUCOSA.skin), MUCOSA.skin)
    assert skin.colour.min() >= 0 and skin.colour.max() <= 1
    assert 0 < skin.bumps.std() < 0.05
    assert skin.colour[..., 0].mean() > skin.colour[..., 1:].mean()


def test_more_roots_more_vessels() -> None:
    few, many = (
        vessel_trees(np.random.default_rng(0), SIZE, roots, 0.01, 0.0) for roots in (1, 12)
    )
    assert few.min() == 0 and many.max() <= 1
    assert 0 < few.mean() < many.mean() < 0.5


def test_vessels_run_along_the_grain() -> None:
    """Vessels along x vary more across than along."""
    trees = vessel_trees(np.random.default_rng(0), SIZE, 12, 0.01, 0.0)
    along, across = (np.abs(np.diff(trees, axis=axis)).mean() for axis in (1, 0))
    assert across > 1.2 * along


def test_lobules_are_about_as_many_as_asked() -> None:
    field = lobules(np.random.default_rng(0), SIZE, 6)
    inner = field[1:-1, 1:-1]
    around = [
        np.roll(field, shift, (0, 1))[1:-1, 1:-1]
        for shift in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))
    ]
    peaks = np.all([inner > other for other in around], axis=0).sum()
    assert field.max() <= 1 and 18 <= peaks <= 72


def test_fluid_gathers_in_the_hollow() -> None:
    dry = Skin(np.full((SIZE, SIZE, 3), 0.5, np.float32), np.full((SIZE, SIZE), 0.01, np.float32))
    for seed in range(4):
        wet = fill_hollows(np.random.default_rng(seed), dry, bowl())
        middle, corner = wet.colour[SIZE // 2, SIZE // 2], wet.colour[2, 2]
        assert np.all(wet.colour <= dry.colour + 1e-6)
        assert middle[0] > middle[2] and np.all(middle < 0.99 * corner)
        assert wet.bumps[SIZE // 2, SIZE // 2] < 0.5 * wet.bumps[2, 2]
