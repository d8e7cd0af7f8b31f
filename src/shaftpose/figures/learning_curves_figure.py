"""The figure of learning curves: all variants side by side."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shaftpose.figures.style import finish, legend, line_style, new_figure

Curves = Sequence[tuple[int, str, float]]  # rows of step, name and value of one training


def learning_curve_figure(trainings: Mapping[str, Sequence[Curves]]) -> Figure:
    """Learning curves by variant title: one panel per name, one line per training, one style per
    variant."""
    rows = [row for variant in trainings.values() for curves in variant for row in curves]
    names = list(dict.fromkeys(name for _, name, _ in rows))
    columns = min(3, max(1, len(names)))
    lines = -(-max(1, len(names)) // columns)
    figure = new_figure(5.0 * columns, 2.8 * lines + 0.5)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=False):
        for index, (title, variant) in enumerate(trainings.items()):
            _draw(axes, name, variant, title, index)
        finish(axes, "step", name)
    for unused in panels[len(names) :]:
        unused.remove()
    legend(figure, panels[0])
    return figure


def _draw(axes: Axes, name: str, variant: Sequence[Curves], title: str, index: int) -> None:
    for number, curves in enumerate(variant):
        points = sorted((step, value) for step, row_name, value in curves if row_name == name)
        steps, values = [step for step, _ in points], [value for _, value in points]
        # One legend entry for all of them.
        axes.plot(steps, values, label="" if number else title, **line_style(index))
