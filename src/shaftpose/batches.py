"""What a network is trained on: batches of images and of what is in them."""

from typing import NamedTuple

from torch import Tensor


class Targets(NamedTuple):
    """The instruments of a batch, padded to G per image.

    boxes: (B, G, 4) float `x0, y0, x1, y1` in units of the image's side; poses: (B, G, 5) float mm
    and deg; valid: (B, G) bool, False for padding; has_pose: (B,) bool, False for real images.
    """

    boxes: Tensor
    poses: Tensor
    valid: Tensor
    has_pose: Tensor


class Batch(NamedTuple):
    """images: (B, 299, 299, 3) uint8 RGB, and their targets."""

    images: Tensor
    targets: Targets
