"""Bootstrap intervals, against the normal theory of means."""

import numpy as np
import pytest

from shaftpose.metrics.bootstrap import interval, mean_interval


def test_a_means_interval_is_that_of_the_normal_theory() -> None:
    values = np.random.default_rng(3).normal(10, 2, size=400)
    found = mean_interval(values.tolist())
    assert found is not None
    half = 1.96 * values.std() / 20
    assert found == pytest.approx((values.mean() - half, values.mean() + half), abs=0.03)


def test_equal_values_have_no_spread_and_runs_agree() -> None:
    assert mean_interval([0.5] * 7) == (0.5, 0.5)
    assert mean_interval([0.0, 1.0, 3.0]) == mean_interval([0.0, 1.0, 3.0])


def test_undefined_statistics_have_no_interval() -> None:
    assert mean_interval([]) is None
    assert interval(3, lambda drawn: None) is None
    # Undefined where image 0 is not drawn: the others decide.
    found = interval(3, lambda drawn: 1.0 if 0 in drawn else None)
    assert found == (1.0, 1.0)
