"""The figure of learning curves: all trainings side by side."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shaftpose.evaluation.figure_style import finish, legend, line_style, new_figure


def learning_curve_figure(curves: Mapping[str, Sequence[tuple[int, str, float]]]) -> Figure:
    """Rows (step, name, value) by title: a panel for each name, a line for each training."""
    names = list(dict.fromkeys(name for rows in curves.values() for _, name, _ in rows))
    columns = min(3, max(1, len(names)))
    lines = -(-max(1, len(names)) // columns)
    figure = new_figure(5.0 * columns, 2.8 * lines + 0.5)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=False):
        _draw_learning(axes, name, curves)
        finish(axes, "step", name)
    for unused in panels[len(names) :]:
        unused.remove()
    legend(figure, panels[0])
    return figure


def _draw_learning(
    axes: Axes, name: str, curves: Mapping[str, Sequence[tuple[int, str, float]]]
) -> None:
    for index, (title, rows) in enumerate(curves.items()):
        points = sorted((step, value) for step, row_name, value in rows if row_name == name)
        steps, values = [step for step, _ in points], [value for _, value in points]
        axes.plot(steps, values, label=title, **line_style(index))
