"""Angles in degrees, on the circle."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Angle = TypeVar("Angle", float, NDArray[np.float64])  # one angle, or many of any shape


def signed_deg(angle: Angle) -> Angle:
    """The same angle in [-180, 180) deg, as for differences."""
    return (angle + 180.0) % 360.0 - 180.0


def unsigned_deg(angle: Angle) -> Angle:
    """The same angle in [0, 360) deg."""
    return angle % 360.0 % 360.0  # twice: the remainder of a tiny negative angle rounds to 360
