"""Choice between heat maps and parallel coordinates."""

import pytest

from studies.sweep_figure import sweep_figure
from studies.sweep_jobs import SweepJob

METRICS = ["mAP", "tip_mm"]


def sweep(*settings: tuple[str, ...]) -> list[SweepJob]:
    """Jobs with these values of the settings a, b and c; all have the same d."""
    return [
        SweepJob(dict(zip("abc", values, strict=False)) | {"d": "7"}, {"mAP": 0.1 * n, "tip_mm": n})
        for n, values in enumerate(settings)
    ]


GRID = [("1", "x"), ("1", "y"), ("2", "x"), ("2", "y")]


def panels(jobs: list[SweepJob]) -> list[str]:
    """The titles of a figure's panels; parallel coordinates have one untitled panel."""
    return [axes.get_title().partition("\n")[0] for axes in sweep_figure(jobs, METRICS).axes]


def test_a_full_grid_of_two_settings_is_a_heat_map_for_each_metric() -> None:
    assert panels(sweep(*GRID)) == METRICS


@pytest.mark.parametrize(
    "settings",
    [
        GRID[:3],  # a job is missing
        [*GRID, GRID[0]],  # a pair has two jobs
        [("1", "x"), ("2", "x")],
        [("1", "x"), ("2", "y")],
        [(*pair, c) for pair in GRID for c in "34"],
    ],
)
def test_any_other_sweep_is_parallel_coordinates(settings: list[tuple[str, ...]]) -> None:
    assert panels(sweep(*settings)) == [""]
