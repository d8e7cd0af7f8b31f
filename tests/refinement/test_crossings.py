"""Shafts that meet in the image."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.refinement.contour import Contour, shaft_contour
from shaftpose.refinement.crossings import leaving_out, met_outlines
from shaftpose.refinement.edges import Offsets
from tests.core.silhouettes import CAMERA, SHAFT

LEVEL = np.array([-10.0, 0.0, 20.0, 90.0, 0.0])  # to the right, through the image's centre
UPRIGHT = np.array([0.0, -8.0, 20.0, 90.0, 90.0])  # downwards, through the centre, too
APART = np.array([-10.0, 12.0, 20.0, 90.0, 0.0])


def everywhere(contour: Contour, reach_px: float) -> Offsets:
    ones = np.ones(len(contour.points))
    return Offsets(0 * ones, ones)


def weights(times: int) -> tuple[NDArray[np.float64], Contour]:
    (outlines, *_) = met_outlines(np.array([LEVEL, UPRIGHT, APART]), SHAFT, CAMERA)
    contour = shaft_contour(LEVEL, SHAFT, CAMERA.enlarged(times))
    return leaving_out(outlines, everywhere, times)(contour, 5.0).weights, contour


def test_shafts_meet_those_that_they_cross() -> None:
    met = met_outlines(np.array([LEVEL, UPRIGHT, APART]), SHAFT, CAMERA)
    assert [len(outlines) for outlines in met] == [1, 2, 1]
    alone = met_outlines(np.array([LEVEL, APART]), SHAFT, CAMERA)
    assert [len(outlines) for outlines in alone] == [0, 0]


def test_shafts_that_one_border_cuts_may_meet_there() -> None:
    poses = np.array(
        [[5.001, -5.583, 13.344, 78.288, -65.245], [20.324, -32.348, 34.006, 66.179, -38.023]]
    )
    for both in (poses, poses[::-1]):
        assert [len(outlines) for outlines in met_outlines(both, SHAFT, CAMERA)] == [1, 1]


def test_samples_on_another_shaft_are_left_out() -> None:
    """The upright shaft is 3 mm wide at 20 mm: 20.5 px around the centre, and a margin of 2."""
    for times in (1, 2):
        kept, contour = weights(times)
        aside = np.abs(contour.points[:, 0] / times - 149.5)
        assert not kept[aside < 11].any()
        assert kept[aside > 14].all()


def test_without_other_shafts_the_search_is_the_same() -> None:
    assert leaving_out([], everywhere) is everywhere
