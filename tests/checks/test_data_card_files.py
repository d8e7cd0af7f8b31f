"""Histograms show the values and the range they are given."""

import numpy as np

from shaftpose.checks.data_card_files import BINS, COLUMNS, Distribution, distribution_figure


def heights(axes) -> list[float]:
    return [patch.get_height() for patch in axes.patches]


def test_a_panel_counts_values_and_marks_their_range():
    values = np.array([0.0, 0.1, 0.1, 3.0])
    (axes,) = distribution_figure([Distribution("x [mm]", "shafts", values, (-1.0, 4.0))]).axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "shafts")
    assert len(axes.patches) == BINS
    assert (heights(axes)[0], heights(axes)[1], heights(axes)[-1]) == (1, 2, 1)
    assert [line.get_xdata()[0] for line in axes.lines] == [-1.0, 4.0]


def test_few_whole_numbers_have_a_bin_each():
    values = np.array([2.0, 2.0, 5.0])
    (axes,) = distribution_figure([Distribution("images", "backgrounds", values, None)]).axes
    assert heights(axes) == [2, 0, 0, 1]
    assert [patch.get_x() for patch in axes.patches] == [1.5, 2.5, 3.5, 4.5]
    assert not axes.lines


def test_there_are_as_many_panels_as_quantities_even_without_values():
    panels = [Distribution(f"q{n}", "shafts", np.empty(0), None) for n in range(COLUMNS + 1)]
    figure = distribution_figure(panels)
    assert [axes.get_xlabel() for axes in figure.axes] == [panel.label for panel in panels]


def test_counts_are_logarithmic_where_one_bin_has_most_of_them():
    panels = [
        Distribution("visible fraction", "shafts", np.array([0.2, 1.0, 1.0]), None),
        Distribution("x [mm]", "shafts", np.array([0.2, 0.5, 1.0]), None),
    ]
    assert [axes.get_yscale() for axes in distribution_figure(panels).axes] == ["log", "linear"]
