"""Training batches: images and the instruments in them."""

from typing import NamedTuple

from torch import Tensor


class Targets(NamedTuple):
    """The instruments of a batch, padded to G per image.

    boxes: (B, G, 4) float `x0, y0, x1, y1` in units of the image's side; poses: (B, G, 5) float mm
    and deg; valid: (B, G) bool, False for padding; has_pose: (B,) bool, False for real images;
    instances: (B, H, W) uint8, instrument number of each pixel, from 1, or 0 for background, or
    `UNKNOWN`; None if the network does not learn masks. tips_px: (B, G, 2) float, tips in images
    without poses, NaN where they are unknown; None if they are unknown in all.
    """

    boxes: Tensor
    poses: Tensor
    valid: Tensor
    has_pose: Tensor
    instances: Tensor | None = None
    tips_px: Tensor | None = None


class Batch(NamedTuple):
    """images: (B, 299, 299, 3) uint8 RGB, and their targets."""

    images: Tensor
    targets: Targets
