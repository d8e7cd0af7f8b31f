"""The results of an evaluation, as `evaluation.json` holds them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from shaftpose.metrics.binned_errors import ErrorBin
from shaftpose.metrics.common_instruments import FoundInstruments
from shaftpose.metrics.metrics import Metrics
from shaftpose.metrics.summary import Summary
from shaftpose.origin import Origin
from shaftpose.stage_files import TrainingFacts


@dataclass(frozen=True)
class Accuracy:
    """Accuracy on the test images; precision_recall: the fields of `PrecisionRecall` as lists.

    summary: None in results of older versions.
    """

    metrics: Metrics
    binned_errors: Mapping[str, Sequence[ErrorBin]]
    found: FoundInstruments
    precision_recall: Mapping[str, Sequence[float]]
    summary: Summary | None = None


@dataclass(frozen=True)
class Evaluation:
    """A trained variant on the test images.

    accuracy: of the network's own poses; fitted: of its fitted poses, None without a fit.
    validation: metrics on the validation images, with the fit if there is one. detection: its
    settings. curves: rows of step, name and value. origin: None in results of older versions.
    """

    title: str
    training: TrainingFacts
    detection: Mapping[str, Any]
    accuracy: Accuracy
    fitted: Accuracy | None
    validation: Metrics
    curves: Sequence[tuple[int, str, float]]
    origin: Origin | None = None
