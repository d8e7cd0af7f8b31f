"""Hydra's callback that tracks a sweep (multirun) as nested MLflow runs."""

from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig


class SweepTracking(Callback):
    """Opens the parent run before any job of a sweep starts, even if jobs run in parallel."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Create database, experiment and parent run."""
        # Hydra loads this module in every stage, but MLflow is slow to import.
        from shaftpose.tracking.connection import connect
        from shaftpose.tracking.sweeps import start_sweep

        connect(**config.tracking)
        folder = Path(config.hydra.sweep.dir).resolve()
        start_sweep(folder, name=f"sweep {folder.name}")
