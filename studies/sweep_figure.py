"""The figure of a sweep: heat maps or parallel coordinates."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from studies.sweep_heat_maps import heat_map_figure, is_full_grid
from studies.sweep_jobs import SweepJob
from studies.sweep_lines import line_figure


def sweep_figure(jobs: Sequence[SweepJob], metrics: Sequence[str]) -> Figure:
    """Heat maps of a full grid of two settings, parallel coordinates of any other sweep."""
    draw = heat_map_figure if is_full_grid(jobs) else line_figure
    return draw(jobs, metrics)
