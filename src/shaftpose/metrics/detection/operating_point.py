"""Choice of the confidence threshold."""

import numpy as np

from shaftpose.metrics.detection.average_precision import PrecisionRecall


def best_confidence(curve: PrecisionRecall) -> float:
    """The confidence threshold with the best F1, the harmonic mean of precision and recall; 0.5 if
    no detection is a true positive.

    Scores are not probabilities: with three hard negatives for each positive, they stay low after a
    short training. The curve must come from validation images, not from test images.
    """
    total = curve.precision + curve.recall
    if not np.any(total > 0):
        return 0.5
    f1 = 2 * curve.precision * curve.recall / np.where(total > 0, total, 1.0)
    return float(curve.scores[f1.argmax()])
