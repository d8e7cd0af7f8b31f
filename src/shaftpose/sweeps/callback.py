"""Hydra's callback that tracks a sweep (multirun) in MLflow and summarises it."""

import sys
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from shaftpose.settings.stage import failed_jobs


class SweepTracking(Callback):
    """Opens the parent run before any job of a sweep starts, and adds a summary at its end."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Create database, experiment and parent run."""
        # Hydra loads this module in every stage, but MLflow is slow to import.
        from shaftpose.tracking.connection import connect
        from shaftpose.tracking.sweeps import start_sweep

        folder = Path(config.hydra.sweep.dir).resolve()
        for error in failed_jobs(folder):  # before it was resumed
            error.unlink()
        experiment = f"{config.tracking.experiment} {folder.name}"
        connect(config.tracking.uri, experiment)
        start_sweep(folder, experiment, swept(config.hydra.overrides.task))

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Print the jobs' table, and add it to the parent run; exit with 1 if a job has failed."""
        from shaftpose.sweeps.summary import summarise

        folder = Path(config.hydra.sweep.dir)
        try:
            summarise(folder.resolve(), config.report.champion_margin)
        finally:  # Hydra only warns of errors here, but this ends it
            if failed := failed_jobs(folder):
                sys.exit(f"error: failed jobs: {', '.join(map(str, failed))}")


def swept(overrides: list[str]) -> dict[str, str]:
    """The keys of a command line that have several values, and these."""
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    pairs = (one.input_line.partition("=") for one in parsed if one.is_sweep_override())
    return {key.lstrip("+"): values for key, _, values in pairs}
