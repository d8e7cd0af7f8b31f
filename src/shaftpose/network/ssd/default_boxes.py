"""SSD300's default boxes (Liu et al., 2016), and the coding of boxes relative to them.

Boxes are in units of the image's side, as `cx, cy, w, h` or as `x0, y0, x1, y1`.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

# For an image side of 300. A map's square boxes have its own scale, and the geometric mean of its
# own and the next one.
SCALES = (30, 60, 111, 162, 213, 264, 315)
ASPECT_RATIOS = ((2,), (2, 3), (2, 3), (2, 3), (2,), (2,))
BOXES_PER_CELL = tuple(2 + 2 * len(ratios) for ratios in ASPECT_RATIOS)
CENTRE_VARIANCE, SIZE_VARIANCE = 0.1, 0.2  # scales of the coding, as in SSD


def default_boxes(centres: Sequence[Sequence[float]]) -> Tensor:
    """(7322, 4) `cx, cy, w, h`, ordered by map, row, column and box in the cell.

    centres: of the cells of each map along either axis. Boxes may extend beyond the image; see
    `clipped`.
    """
    return torch.cat([_map_boxes(torch.tensor(c), _cell_shapes(i)) for i, c in enumerate(centres)])


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


def clipped(boxes: Tensor) -> Tensor:
    """Boxes (A, 4) `cx, cy, w, h`, clipped to the image.

    Boxes of shafts end at the image's border. Clipped default boxes overlap them more, so twice as
    many match.
    """
    return to_centre(to_corners(boxes).clamp(0.0, 1.0))


def encode_boxes(boxes: Tensor, defaults: Tensor) -> Tensor:
    """Boxes (..., A, 4) `x0, y0, x1, y1` and defaults (A, 4) `cx, cy, w, h` -> (..., A, 4)."""
    boxes = to_centre(boxes)
    centre = (boxes[..., :2] - defaults[..., :2]) / defaults[..., 2:] / CENTRE_VARIANCE
    size = torch.log(boxes[..., 2:] / defaults[..., 2:]) / SIZE_VARIANCE
    return torch.cat([centre, size], dim=-1)


def decode_boxes(offsets: Tensor, defaults: Tensor) -> Tensor:
    """Offsets (..., A, 4) and defaults `cx, cy, w, h` -> (..., A, 4) `x0, y0, x1, y1`."""
    centre = defaults[..., :2] + offsets[..., :2] * CENTRE_VARIANCE * defaults[..., 2:]
    size = defaults[..., 2:] * torch.exp(offsets[..., 2:] * SIZE_VARIANCE)
    return to_corners(torch.cat([centre, size], dim=-1))


def to_corners(boxes: Tensor) -> Tensor:
    """(..., 4) `cx, cy, w, h` -> (..., 4) `x0, y0, x1, y1`."""
    centre, size = boxes[..., :2], boxes[..., 2:]
    return torch.cat([centre - size / 2, centre + size / 2], dim=-1)


def to_centre(boxes: Tensor) -> Tensor:
    """(..., 4) `x0, y0, x1, y1` -> (..., 4) `cx, cy, w, h`."""
    low, high = boxes[..., :2], boxes[..., 2:]
    return torch.cat([(low + high) / 2, high - low], dim=-1)


def pairwise_iou(first: Tensor, second: Tensor) -> Tensor:
    """(..., N, 4) and (..., M, 4) `x0, y0, x1, y1` -> (..., N, M); 0 where both are empty."""
    a, b = first[..., :, None, :], second[..., None, :, :]
    low = torch.maximum(a[..., :2], b[..., :2])
    high = torch.minimum(a[..., 2:], b[..., 2:])
    shared = (high - low).clamp(min=0).prod(dim=-1)
    union = _area(a) + _area(b) - shared
    return shared / union.clamp(min=torch.finfo(union.dtype).tiny)


def _area(boxes: Tensor) -> Tensor:
    return (boxes[..., 2:] - boxes[..., :2]).prod(dim=-1)
