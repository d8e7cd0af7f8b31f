"""A network small enough for tests, the losses of conf/variant, and limits."""

import torch

from shaftpose.network.dense.loss import DenseLoss
from shaftpose.network.ssd.heads import ArchitectureD
from shaftpose.network.ssd.inception_v4 import InceptionV4Features
from shaftpose.network.ssd.loss import ShaftLoss
from shaftpose.network.ssd.pose_coding import PoseCoder
from shaftpose.network.ssd.single_shot import SingleShotNetwork
from shaftpose.settings.schema import DetectionSettings

LIMITS = DetectionSettings(
    top_k=250, nms_iou=0.5, max_detections=20, confidence_threshold=None, refine="edges"
)


E_LOSS = DenseLoss(mask=3.0, border=9.0, border_px=2.5, tip_cells=9.0, smooth=0.1)


def paper_loss() -> ShaftLoss:
    """The loss with the paper's weights."""
    return ShaftLoss(alpha=1.5, beta=(1, 1, 2, 2, 2), gamma=5.0)


def tiny_d(coder: PoseCoder) -> SingleShotNetwork:
    """Architecture D with reproducible weights."""
    torch.manual_seed(0)
    return SingleShotNetwork(InceptionV4Features(0.1875, 0.25), ArchitectureD, coder, paper_loss())
