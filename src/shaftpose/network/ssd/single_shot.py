"""The paper's network: backbone, head, default boxes and pose coder."""

from collections.abc import Callable

from pydantic import ConfigDict, validate_call
from torch import Tensor, nn

from shaftpose.dataset.batches import Targets
from shaftpose.network.pose_network import DecodedOutputs, PoseNetwork
from shaftpose.network.ssd.decoding import decode
from shaftpose.network.ssd.default_boxes import BOXES_PER_CELL, clipped, default_boxes
from shaftpose.network.ssd.heads import HeadOutputs
from shaftpose.network.ssd.inception_v4 import InceptionV4Features
from shaftpose.network.ssd.loss import ShaftLoss
from shaftpose.network.ssd.pose_coding import PoseCoder
from shaftpose.settings.schema import DetectionSettings, PoseRanges


class SingleShotNetwork(PoseNetwork):
    """Finds shafts and their poses in one pass, from default boxes.

    `head` is a class of `heads`, or a function with the arguments of one. `pose_coder` states how
    many numbers the head predicts for a pose, and decodes them.
    """

    defaults: Tensor

    def __init__(
        self,
        backbone: InceptionV4Features,
        head: Callable[..., nn.Module],
        pose_coder: PoseCoder,
        loss: ShaftLoss,
    ) -> None:
        super().__init__()
        self.backbone = backbone
        self.head = head(
            in_channels=backbone.channels,
            boxes_per_cell=BOXES_PER_CELL,
            width=backbone.width,
            pose_values=pose_coder.values,
        )
        self.pose_coder = pose_coder
        self.continuous = pose_coder.continuous
        self.loss = loss
        defaults = clipped(default_boxes(backbone.cell_centres()))
        self.register_buffer("defaults", defaults, persistent=False)

    def forward(self, images: Tensor) -> HeadOutputs:
        """(B, 3, 299, 299) in [-1, 1] -> predictions for the A = 7322 default boxes."""
        return self.head(self.backbone(images))

    def loss_terms(self, outputs: HeadOutputs, targets: Targets) -> dict[str, Tensor]:
        """The paper's loss (III-E), its terms, and the number of matched default boxes."""
        return self.loss(outputs, targets, self.defaults, self.pose_coder)._asdict()

    def detections(self, outputs: HeadOutputs, limits: DetectionSettings) -> DecodedOutputs:
        """The best boxes after non-maximum suppression and their poses."""
        return decode(outputs, self.defaults, self.pose_coder, limits)


@validate_call(config=ConfigDict(arbitrary_types_allowed=True))
def single_shot_network(
    backbone: InceptionV4Features,
    head: Callable[..., nn.Module],
    pose_coder: Callable[..., PoseCoder],
    poses: PoseRanges,
    loss: ShaftLoss,
) -> SingleShotNetwork:
    """Build the network from the components in a variant's file.

    pose_coder: built from the lower and the upper ends of the ranges `poses`.
    """
    return SingleShotNetwork(backbone, head, pose_coder(poses.low, poses.high), loss)
