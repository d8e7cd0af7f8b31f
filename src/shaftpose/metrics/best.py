"""The rule by which models are compared: mAP first, then the tip error."""

import math
from collections.abc import Mapping

from shaftpose.metrics.table import MetricValues


def best_of(validation: Mapping[str, MetricValues], margin: float) -> str:
    """The name with the lowest tip error among those whose mAP is within `margin` of the best.

    Whoever detected no instrument has no tip error and comes last; of equals, the first is taken.
    """
    mean_ap = {name: values.get("mAP") or 0.0 for name, values in validation.items()}
    close = [n for n, value in mean_ap.items() if value >= max(mean_ap.values()) - margin]
    tips = {name: validation[name].get("tip_mm") for name in close}
    far = {name: math.inf if tip is None else tip for name, tip in tips.items()}
    return min(close, key=far.__getitem__)
