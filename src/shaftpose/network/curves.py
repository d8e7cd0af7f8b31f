"""Learning curves: what a training logs, kept in memory until it is written as one table."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers.logger import Logger

from shaftpose.files import new_file


class Curves(Logger):
    """Collects what Lightning logs as rows of step, name, value.

    Rows are plain values, so that they go into the checkpoint of an unfinished training: a file
    that is written while training goes on would lack steps, or hold some twice, after a kill.
    """

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[tuple[int, str, float]] = []

    @property
    def name(self) -> str:
        """A logger must have one."""
        return "curves"

    @property
    def version(self) -> str:
        """There is but one."""
        return ""

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Append a row for each metric but Lightning's count of epochs."""
        assert step is not None
        self.rows += [(step, name, value) for name, value in metrics.items() if name != "epoch"]

    def log_hyperparams(self, *args: Any, **kwargs: Any) -> None:
        """Hyper-parameters are no curves."""

    def write(self, path: Path) -> None:
        """Write all rows as CSV."""
        with new_file(path) as part, part.open("w", newline="") as stream:
            table = csv.writer(stream, lineterminator="\n")
            table.writerow(["step", "name", "value"])
            table.writerows(self.rows)
