"""The trained network as users see it: images in, instruments out."""

from torch import Tensor, nn

from shaftpose.network.pose_network import DecodedOutputs, PoseNetwork, normalise_images
from shaftpose.settings.parts import DetectionSettings


class ShaftDetector(nn.Module):
    """A network followed by the decoding of its outputs."""

    def __init__(self, network: PoseNetwork, limits: DetectionSettings) -> None:
        super().__init__()
        self.network = network
        self.limits = limits

    def forward(self, image: Tensor) -> DecodedOutputs:
        """(N, 299, 299, 3) uint8 RGB -> boxes (N, K, 4), scores (N, K), poses (N, K, 5).

        K is `limits.max_detections`. Boxes in pixels, poses in mm and deg, best score first, padded
        with zeros.
        """
        return self.network.detections(self.network(normalise_images(image)), self.limits)
