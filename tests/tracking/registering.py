"""Models in the registry of a test's MLflow database."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from shaftpose.tracking.models import log_model
from shaftpose.tracking.registry import register_candidate


def export(training_id: str, model: Path) -> None:
    """Log a model to its training's run."""
    log_model(training_id, "d", model, np.zeros((1, 299, 299, 3), dtype=np.uint8))


def register(
    training_id: str,
    is_better: Callable[[Mapping[str, str]], bool] = lambda other: True,
    **tags: str,
) -> None:
    """Register a training's model, which is better than all others unless said otherwise."""
    known = {"profile": "demo", "dataset": "aa", **tags}
    register_candidate(training_id, "d", "the rule", known, is_better)
