"""SSD300's default boxes (Liu et al., 2016) on the six maps, in units of the image's side."""

from collections.abc import Sequence

import torch
from torch import Tensor

from shaftpose.network.ssd.boxes import to_centre, to_corners

# For an image side of 300. A map's square boxes have its own scale, and the geometric mean of its
# own and the next one.
SCALES = (30, 60, 111, 162, 213, 264, 315)
ASPECT_RATIOS = ((2,), (2, 3), (2, 3), (2, 3), (2,), (2,))
BOXES_PER_CELL = tuple(2 + 2 * len(ratios) for ratios in ASPECT_RATIOS)


def default_boxes(centres: Sequence[Sequence[float]]) -> Tensor:
    """(7322, 4) `cx, cy, w, h`, ordered by map, row, column and box in the cell.

    centres: cell centres of each map along either axis, in units of the image's side. Boxes may
    extend beyond the image; see `clipped`.
    """
    return torch.cat([_map_boxes(torch.tensor(c), _cell_shapes(i)) for i, c in enumerate(centres)])


def clipped(boxes: Tensor) -> Tensor:
    """Boxes (A, 4) `cx, cy, w, h`, clipped to the image.

    Boxes of shafts end at the image's border. Clipped default boxes overlap them more, so twice as
    many match.
    """
    return to_centre(to_corners(boxes).clamp(0.0, 1.0))


def _cell_shapes(map_index: int) -> Tensor:
    """(N, 2) `w, h` of a cell's boxes: two squares, then each ratio in landscape and portrait."""
    scale, next_scale = SCALES[map_index] / 300, SCALES[map_index + 1] / 300
    between = (scale * next_scale) ** 0.5
    shapes = [(scale, scale), (between, between)]
    for ratio in ASPECT_RATIOS[map_index]:
        long, short = scale * ratio**0.5, scale / ratio**0.5
        shapes += [(long, short), (short, long)]
    return torch.tensor(shapes)


def _map_boxes(centres: Tensor, shapes: Tensor) -> Tensor:
    """(size * size * N, 4): the shapes (N, 2) at every cell of a map with these `size` centres."""
    cy, cx = torch.meshgrid(centres, centres, indexing="ij")
    centres = torch.stack([cx, cy], dim=-1).reshape(-1, 1, 2)
    cells, count = len(centres), len(shapes)
    return torch.cat(
        [centres.expand(cells, count, 2), shapes.expand(cells, count, 2)], dim=-1
    ).reshape(-1, 4)
