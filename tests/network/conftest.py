import pytest
import torch

from shaftpose.network.heads import ArchitectureD
from shaftpose.network.inception_v4 import InceptionV4Features
from shaftpose.network.pose_coding import PoseCoder
from shaftpose.network.shaft_network import ShaftNetwork


@pytest.fixture
def pose_coder() -> PoseCoder:
    return PoseCoder(low=(-20, -20, 10, 50, 0), high=(20, 20, 40, 90, 358))


@pytest.fixture
def tiny_network(pose_coder: PoseCoder) -> ShaftNetwork:
    torch.manual_seed(0)
    return ShaftNetwork(InceptionV4Features(0.04), ArchitectureD, pose_coder)
