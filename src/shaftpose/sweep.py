"""Hydra callback that tracks a multirun as nested MLflow runs."""

from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig


class SweepTracking(Callback):
    """Opens the parent run before any job of a sweep starts, even if jobs run in parallel."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Create database, experiment and parent run; record the run in the sweep's folder."""
        from shaftpose import tracking  # Hydra loads this module in every stage; MLflow is slow

        tracking.connect(**config.tracking)
        folder = Path(config.hydra.sweep.dir).resolve()
        tracking.start_sweep(folder, name=f"sweep {folder.name}")
