"""From which score on a detection counts."""

import numpy as np

from shaftpose.evaluation.average_precision import PrecisionRecall


def best_confidence(curve: PrecisionRecall) -> float:
    """The score with the best F1, the harmonic mean of precision and recall; 0.5 if no detection
    is right.

    Scores are no probabilities: training with three hard negatives for each positive keeps those
    of a short training low. The curve must be that of validation images, not of test images.
    """
    total = curve.precision + curve.recall
    if not np.any(total > 0):
        return 0.5
    f1 = 2 * curve.precision * curve.recall / np.where(total > 0, total, 1.0)
    return float(curve.scores[f1.argmax()])
