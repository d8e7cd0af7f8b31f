"""Common style of all figures: colours, axes, legend and file; no global plotting state."""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from shaftpose.core.files import new_file

# Okabe and Ito's colours are safe for common colour blindness; line styles help in greyscale.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
LINE_STYLES = ("-", "--", "-.", ":")
INK, SOFT, GRID = "#1b2430", "#5c6877", "#e1e5ea"


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, size in inches; its panels leave room for tick labels."""
    return Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.06))


def finish(axes: Axes, x_label: str, y_label: str) -> None:
    """Apply the common style: no box, a light grid behind the data, muted labels."""
    axes.set_xlabel(x_label, color=INK, fontsize=10)
    axes.set_ylabel(y_label, color=INK, fontsize=10)
    axes.tick_params(colors=SOFT, labelcolor=INK, labelsize=9, length=0)
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GRID)


def legend(figure: Figure, axes: Axes) -> None:
    """Add one legend above all panels, with as many columns as fit the figure."""
    columns = int(figure.get_figwidth() // 2.4)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside upper center",
        ncols=min(columns, max(1, len(labels))),
        frameon=False,
        fontsize=10,
        labelcolor=INK,
    )


def line_style(index: int) -> dict[str, Any]:
    """Colour and style of line number `index`, as arguments of `plot`."""
    style = LINE_STYLES[index % len(LINE_STYLES)]
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": style}


def save_figure(figure: Figure, path: Path) -> None:
    """Write a PNG whose bytes depend only on the figure: no date, no software version."""
    with new_file(path) as part:
        figure.savefig(part, format="png", dpi=150, facecolor="white", metadata={"Software": None})
