"""The cells of heat maps, read from the figure."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from shaftpose.sweeps.heat_maps import heat_map_figure
from shaftpose.sweeps.jobs import SweepJob

METRICS = ["mAP", "tip_mm", "axis_deg"]
# Sorted neither by value nor as a table.
JOBS = [
    SweepJob(
        {"loss.alpha": alpha, "loss.gamma": gamma, "seed": "7"},
        dict(zip(METRICS, values, strict=False)),
    )
    for alpha, gamma, values in (
        ("10.0", "5", (0.6, 5.0, 30.0)),
        ("0.5", "25", (0.2, 9.0, 60.0)),
        ("1.5", "5", (0.9, 1.0, 10.0)),
        ("0.5", "5", (0.0,)),
        ("10.0", "25", (0.3, 6.0, 50.0)),
        ("1.5", "25", (0.1, 8.0, 20.0)),
    )
]


def cells(figure: Figure) -> list[dict[tuple[str, str], str]]:
    """The texts in each map, by the labels of column and row."""
    first = figure.axes[0]
    columns, rows = (
        dict(zip(axis.get_ticklocs(), (t.get_text() for t in axis.get_ticklabels()), strict=True))
        for axis in (first.xaxis, first.yaxis)
    )
    places = [{text.get_position(): text.get_text() for text in a.texts} for a in figure.axes]
    return [{(columns[x], rows[y]): text for (x, y), text in found.items()} for found in places]


def colours(axes: Axes) -> dict[tuple[float, float], tuple[float, ...]]:
    """The colour of each cell by the position of its text."""
    (mesh,) = axes.collections
    mesh.update_scalarmappable()
    drawn = mesh.get_facecolors().reshape(*mesh.get_array().shape, 4)
    places = [text.get_position() for text in axes.texts]
    return {(x, y): tuple(drawn[int(y), int(x), :3]) for x, y in places}


def test_each_value_is_in_the_cell_of_its_settings() -> None:
    found, tips, _ = cells(heat_map_figure(JOBS, METRICS))
    assert found == {
        ("5", "0.5"): "0.000", ("25", "0.5"): "0.200",
        ("5", "1.5"): "0.900", ("25", "1.5"): "0.100",
        ("5", "10.0"): "0.600", ("25", "10.0"): "0.300",
    }  # fmt: skip
    assert (tips["25", "0.5"], tips["5", "10.0"]) == ("9.00", "5.00")


def test_axes_are_in_the_order_of_their_values() -> None:
    axes = heat_map_figure(JOBS, METRICS).axes[0]
    # alpha has the longer values and is on the vertical axis.
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("loss.gamma", "loss.alpha")
    assert [text.get_text() for text in axes.get_xticklabels()] == ["5", "25"]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["0.5", "1.5", "10.0"]
    assert axes.get_xlim() == (0, 2) and axes.get_ylim() == (0, 3)


def test_a_job_without_a_right_detection_is_marked() -> None:
    figure = heat_map_figure(JOBS, METRICS)
    marked = [[at for at, text in found.items() if "no correct" in text] for found in cells(figure)]
    assert marked == [[], [("5", "0.5")], [("5", "0.5")]]
    grey = np.array(colours(figure.axes[1])[0.5, 0.5])
    np.testing.assert_allclose(grey, to_rgb("#e1e5ea"), atol=0.01)


def test_the_best_cell_has_the_same_colour_in_all_maps() -> None:
    maps = [colours(axes) for axes in heat_map_figure(JOBS, METRICS).axes]
    # mAP 0.9, 1 mm and 10 deg belong to one job; mAP 0, 9 mm and 60 deg are the worst values.
    best, worst = [found[0.5, 1.5] for found in maps], [maps[0][0.5, 0.5], maps[1][1.5, 0.5]]
    assert best[0] == best[1] == best[2]
    assert worst[0] == worst[1] == maps[2][1.5, 0.5]
    assert sum(best[0]) > sum(worst[0])  # lighter


def light(colour: Sequence[float]) -> float:
    """Relative luminance as defined by the Web Content Accessibility Guidelines (WCAG)."""
    parts = np.array(colour)
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


def test_what_is_written_stands_out() -> None:
    for axes in heat_map_figure(JOBS, METRICS).axes:
        behind = colours(axes)
        for text in axes.texts:
            pair = light(to_rgb(text.get_color())), light(behind[text.get_position()])
            assert (max(pair) + 0.05) / (min(pair) + 0.05) > 3


def test_long_values_are_cut_and_stand_on_the_vertical_axis() -> None:
    long = "folder/" * 9
    jobs = [SweepJob({"a": f"{long}{n}", "b": b}, {"mAP": 0.0}) for n in "12" for b in "34"]
    nothing_right = cells(heat_map_figure(jobs, METRICS))[1]
    assert set(nothing_right) == {(b, f"…{long[-28:]}{n}") for n in "12" for b in "34"}
