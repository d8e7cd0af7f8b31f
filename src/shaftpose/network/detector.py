"""The trained network as users see it: images in, instruments out."""

from torch import Tensor, nn

from shaftpose.network.pose_network import MaskNetwork, PoseNetwork, normalise_images
from shaftpose.settings.schema import DetectionSettings


class ShaftDetector(nn.Module):
    """A network followed by the decoding of its outputs."""

    def __init__(self, network: PoseNetwork, limits: DetectionSettings) -> None:
        super().__init__()
        self.network = network
        self.limits = limits

    @property
    def output_names(self) -> tuple[str, ...]:
        """The names of the tensors that `forward` returns."""
        mask = ("mask",) if isinstance(self.network, MaskNetwork) else ()
        return ("boxes", "scores", "poses", *mask)

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """(N, 299, 299, 3) uint8 RGB -> boxes (N, K, 4), scores (N, K), poses (N, K, 5).

        K is `limits.max_detections`. Boxes in pixels, poses in mm and deg, best score first, padded
        with zeros. For networks that predict it, also the mask (N, h, w), see `MaskNetwork.masks`.
        """
        outputs = self.network(normalise_images(image))
        decoded = self.network.detections(outputs, self.limits)
        if isinstance(self.network, MaskNetwork):
            return (*decoded, self.network.masks(outputs))
        return decoded
