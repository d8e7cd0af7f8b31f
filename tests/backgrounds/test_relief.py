import numpy as np

from shaftpose.backgrounds.relief import SURFACES, VIEW, funnel, make_relief, melted

SIZE = 64
RADIUS = (0.12, 0.42)


def test_a_funnel_leads_away_and_leaves_the_wall_outside_alone() -> None:
    for seed in range(8):
        hole = funnel(np.random.default_rng(seed), SIZE)
        # The end is at most as deep as a tube visible to a quarter of its radius, plus a ring.
        assert -np.log(4) / VIEW - 0.03 < hole.min() < -0.1
        assert hole.max() < 0.03


def test_folds_come_before_the_wall() -> None:
    """The same wall with and without folds: folds move nothing further away."""
    for seed in range(4):
        bare, folded = (
            make_relief(np.random.default_rng(seed), SIZE, folds, RADIUS, opened=True)
            for folds in (0, 4)
        )
        assert not bare.surface.any()
        assert (folded.height - bare.height).min() > -0.01
        assert (folded.height - bare.height).max() > 0.05


def test_all_surfaces_occur() -> None:
    found = {
        int(number)
        for seed in range(6)
        for number in np.unique(
            make_relief(np.random.default_rng(seed), SIZE, 5, RADIUS, opened=False).surface
        )
    }
    assert found == set(range(SURFACES))


def test_melting_keeps_the_higher_and_fills_the_valley() -> None:
    rising = np.linspace(0, 1, 11, dtype=np.float32)
    joined = melted(rising, rising[::-1], 0.1)
    assert np.all(joined >= np.maximum(rising, rising[::-1]))
    assert np.argmax(joined - np.maximum(rising, rising[::-1])) == 5
