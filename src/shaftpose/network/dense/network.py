"""Architecture E: a dense single-shot network, a small residual U-Net. Not in the paper.

It predicts two masks, of all shafts and of all instruments with jaws and wrists, at half the
image's resolution. At a quarter it predicts a heat map of the tips and, for every pixel of a shaft,
the offset to its tip, the tip's depth and the direction of the axis. An edge reader is trained
along with it, on the same images; the two share no weights.
"""

from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

import torch
from pydantic import validate_call
from torch import Tensor, nn
from torch.nn import functional

from shaftpose.core.geometry import Camera
from shaftpose.dataset.batches import Targets
from shaftpose.network.dense.coding import Grid
from shaftpose.network.dense.decoding import decode
from shaftpose.network.dense.edge_reader import EdgeReader, edge_samples
from shaftpose.network.dense.layers import Residual, conv_norm_relu
from shaftpose.network.dense.lite0 import LEVELS, Lite0
from shaftpose.network.dense.loss import DenseLoss
from shaftpose.network.gradients import with_packed_gradient
from shaftpose.network.pose_network import DecodedOutputs, MaskNetwork
from shaftpose.refinement.contour import Shaft
from shaftpose.settings.schema import (
    CameraSettings,
    DetectionSettings,
    Distortion,
    PositiveInt,
    ShaftSettings,
)

MASKS = 2  # shafts; all instruments
MAPS = 7  # tip; offset to the tip (2); depth; axis (3)
_RARE = -4.0  # initial logit of a tip


class DenseOutputs(NamedTuple):
    """mask: (B, 2, h, w) logits of a shaft and of any part of an instrument, at half the images'
    resolution; maps: (B, 7, h, w), at a quarter,
    the tip's logit and the values of `coding`; images: (B, 3, H, W), the input, from which the edge
    reader learns."""

    mask: Tensor
    maps: Tensor
    images: Tensor


class DenseNetwork(MaskNetwork):
    """The U-Net and the edge reader.

    channels: of the encoder's levels at 1/2, 1/4, ... of the image's resolution; None: the encoder
    is EfficientNet-lite0; shaft: None if the shape of its outline is unknown: there is no edge
    reader then.
    """

    needs_instances = True
    takes_any_size = True

    def __init__(
        self, channels: Sequence[int] | None, camera: Camera, shaft: Shaft | None, loss: DenseLoss
    ) -> None:
        super().__init__()
        self.camera, self.shaft, self.loss = camera, shaft, loss
        self.side_px = camera.width
        self.edges = None if shaft is None else EdgeReader()
        self.down = Lite0() if channels is None else _scratch_encoder(channels)
        channels = LEVELS if channels is None else channels
        self.up = nn.ModuleList(
            conv_norm_relu(fine + coarse, fine)
            for fine, coarse in zip(channels, channels[1:], strict=False)
        )
        self.mask = nn.Conv2d(channels[0], MASKS, 3, padding=1)
        self.maps = nn.Sequential(conv_norm_relu(channels[1], 64), nn.Conv2d(64, MAPS, 1))
        bias = self.maps[1].bias
        assert isinstance(bias, Tensor)
        nn.init.constant_(bias[:1], _RARE)

    def forward(self, images: Tensor) -> DenseOutputs:
        """(B, 3, H, W) in [-1, 1] -> mask and maps."""
        levels, x = [], images
        for stage in self.down:
            x = stage(x)
            levels.append(x)
        maps = x
        for level in reversed(range(len(self.up))):
            fine = levels[level]
            x = functional.interpolate(x, size=fine.shape[-2:], mode="bilinear")
            x = with_packed_gradient(x) if self.training else x
            x = self.up[level](torch.cat([x, fine], dim=1))
            if level == 1:
                maps = self.maps(x)
        return DenseOutputs(self.mask(x), maps, images)

    def loss_terms(self, outputs: DenseOutputs, targets: Targets) -> dict[str, Tensor]:
        """The loss and its mask, tool, tip, pose and edge terms."""
        terms = self.loss(outputs.mask, outputs.maps, targets, self._grid(outputs, outputs.maps))
        if self.edges is None or self.shaft is None:
            return terms
        samples = edge_samples(outputs.images, targets, self.shaft)
        edge = self.edges.loss(samples)
        return {**terms, "loss": terms["loss"] + edge, "edge": edge}

    def detections(self, outputs: DenseOutputs, limits: DetectionSettings) -> DecodedOutputs:
        """One instrument for each peak of the tip heat map."""
        fine, grid = self._grid(outputs, outputs.mask), self._grid(outputs, outputs.maps)
        return decode(outputs.mask[:, :1], outputs.maps, fine, grid, limits)

    def _grid(self, outputs: DenseOutputs, values: Tensor) -> Grid:
        """The grid of values (B, C, h, w) over the images, seen by the reference camera."""
        return Grid.over(outputs.images, values.shape[-2], values.shape[-1], self.camera.focal_px)

    def edge_reader(self) -> EdgeReader | None:
        """The edge reader, unless the outline of the shaft is not known."""
        return self.edges

    def masks(self, outputs: DenseOutputs) -> tuple[Tensor, Tensor]:
        """Probabilities of a shaft and of any part of an instrument, (B, H, W) each.

        As in the loss, logits are enlarged, not probabilities: an edge between two cells is where
        the interpolated logit is 0.
        """
        size = outputs.images.shape[-2:]
        wide = functional.interpolate(outputs.mask.float(), size=size, mode="bilinear")
        shafts, tools = wide.sigmoid().unbind(1)
        return shafts, tools

    def load_pretrained(self) -> None:
        """Load the weights that `lite0` has learned on ImageNet."""
        if isinstance(self.down, Lite0):
            self.down.load_imagenet_weights()

    def pretrained(self) -> Iterable[nn.Parameter]:
        """The weights of `lite0`."""
        return self.down.parameters() if isinstance(self.down, Lite0) else ()


def _scratch_encoder(channels: Sequence[int]) -> nn.ModuleList:
    """Stages with random weights: a strided convolution each and, except in the first, a residual
    block."""
    before = (3, *channels[:-1])
    return nn.ModuleList(
        nn.Sequential(conv_norm_relu(i, o, stride=(2, 2)), *([Residual(o)] if i > 3 else []))
        for i, o in zip(before, channels, strict=True)
    )


@validate_call
def dense_network(
    encoder: Literal["scratch", "lite0"],
    channels: tuple[PositiveInt, ...] | None,
    camera: CameraSettings,
    shaft: ShaftSettings,
    distortion: Distortion,
    loss: DenseLoss,
) -> DenseNetwork:
    """Build the network from the values in a variant's file.

    channels: of the encoder `scratch`, None for `lite0`, else ValueError is raised. The outline of
    an instrument from a CAD file, or through a distorting lens, is not known.
    """
    known = shaft.cad is None and not any((*distortion.k1, *distortion.k2))
    outlined = Shaft(shaft.diameter_mm, shaft.length_mm, shaft.tip == "flat")
    pinhole = Camera.from_field_of_view(camera.size_px, camera.size_px, camera.view_deg)
    if (channels is None) == (encoder == "scratch"):
        raise ValueError(f"channels = {channels} with encoder {encoder}: lite0 has its own (null)")
    return DenseNetwork(channels, pinhole, outlined if known else None, loss)
