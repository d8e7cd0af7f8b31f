"""The table of a sweep and the choice of its figures."""

import csv
from pathlib import Path

import pytest

from shaftpose.sweeps.jobs import SweepJob
from shaftpose.sweeps.table import DRAWN, read_table, sweep_figures, write_table
from studies.write_results_page import swept_figures

FOUND = {"validation/mAP": 0.5, "validation/tip_mm": 4.25, "validation/axis_deg": 9.0}
JOBS = [
    SweepJob({"variant.name": "b", "loss.alpha": "1.5", "variant.steps": "[1, 5]"}, FOUND, 6),
    SweepJob({"variant.name": "d", "loss.alpha": "1.5"}, {"validation/mAP": 0.0}, 6),
]


def test_a_table_has_swept_parameters_first_and_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "reports/sweeps/heads.csv"
    write_table(JOBS, path)
    headings, *rows = csv.reader(path.read_text().splitlines())
    assert headings == [
        "variant.name", "loss.alpha", "loss.gamma", "seed", "training_images",
        "size.batch_size", "size.width", "size.depth", "size.learning_rate", "steps", *DRAWN,
    ]  # fmt: skip
    assert rows == [
        ["b", "1.5", "", "", "", "", "", "", "", "6", "0.5", "4.25", "9"],
        ["d", "1.5", "", "", "", "", "", "", "", "6", "0", "", ""],
    ]
    without = SweepJob({"variant.name": "b", "loss.alpha": "1.5"}, FOUND, 6)
    assert read_table(path) == [without, JOBS[1]]
    assert list(swept_figures(tmp_path)) == ["images/sweep-heads.png"]


def jobs_of(*settings: tuple[str, ...]) -> list[SweepJob]:
    """Jobs with these values of the settings a, b and c; all have the same d."""
    return [
        SweepJob(dict(zip("abc", values, strict=False)) | {"d": "7"}, dict.fromkeys(DRAWN, 0.1 * n))
        for n, values in enumerate(settings)
    ]


GRID = [("1", "x"), ("1", "y"), ("2", "x"), ("2", "y")]


def test_a_full_grid_of_two_settings_has_a_heat_map_for_each_metric() -> None:
    maps, lines = sweep_figures(jobs_of(*GRID)).values()
    assert [axes.get_title().partition("\n")[0] for axes in maps.axes] == list(DRAWN)
    assert [axes.get_title() for axes in lines.axes] == [""]


def test_equal_jobs_have_no_figure() -> None:
    assert sweep_figures(jobs_of(("1", "x"))) == {}


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
def test_any_other_sweep_has_parallel_coordinates_alone(settings: list[tuple[str, ...]]) -> None:
    assert list(sweep_figures(jobs_of(*settings))) == ["lines"]
