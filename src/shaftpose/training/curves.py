"""Learning curves: logged values, kept in memory and written as one table."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers.logger import Logger

from shaftpose.core.files import write_csv


class Curves(Logger):
    """Collects the values that Lightning logs as rows of step, name, value.

    The checkpoint of an unfinished training stores the rows: a file written during training would
    lack or repeat steps after a kill.
    """

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[tuple[int, str, float]] = []

    @property
    def name(self) -> str:
        """Required by `Logger`."""
        return "curves"

    @property
    def version(self) -> str:
        """Required by `Logger`; unused."""
        return ""

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Append a row for each metric except Lightning's epoch."""
        assert step is not None
        self.rows += [(step, name, value) for name, value in metrics.items() if name != "epoch"]

    def log_hyperparams(self, *args: Any, **kwargs: Any) -> None:
        """Ignore hyper-parameters."""

    def write(self, path: Path) -> None:
        """Write all rows as CSV."""
        write_csv(path, ["step", "name", "value"], self.rows)
