"""The trained network as users see it: images in, instruments out."""

from torch import Tensor, nn

from shaftpose.network.decoding import DecodedOutputs, decode
from shaftpose.network.shaft_network import ShaftNetwork, normalise_images


class ShaftDetector(nn.Module):
    """A network with decoding and non-maximum suppression behind it."""

    def __init__(self, network: ShaftNetwork, top_k: int, iou_threshold: float, keep: int) -> None:
        super().__init__()
        self.network = network
        self.top_k = top_k
        self.iou_threshold = iou_threshold
        self.keep = keep

    def forward(self, image: Tensor) -> DecodedOutputs:
        """(N, 299, 299, 3) uint8 RGB -> boxes (N, keep, 4), scores (N, keep), poses (N, keep, 5).

        Boxes in pixels, poses in mm and deg, best score first, padded with zeros.
        """
        network = self.network
        outputs = network(normalise_images(image))
        return decode(
            outputs, network.defaults, network.pose_coder,
            self.top_k, self.iou_threshold, self.keep,
        )  # fmt: skip
