"""Default boxes of maps whose cells divide the image evenly: easy to compute by hand."""

from torch import Tensor

from shaftpose.network.ssd.default_boxes import default_boxes
from shaftpose.network.ssd.inception_v4 import MAP_SIZES

EVEN_CENTRES = [[(cell + 0.5) / size for cell in range(size)] for size in MAP_SIZES]


def even_boxes() -> Tensor:
    """(7322, 4) `cx, cy, w, h`."""
    return default_boxes(EVEN_CENTRES)
