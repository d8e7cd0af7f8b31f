import pytest
import torch

from shaftpose.network.heads import ArchitectureD
from shaftpose.network.inception_v4 import InceptionV4Features
from shaftpose.network.pose_bins import BinCoder
from shaftpose.network.pose_coding import RegressionCoder
from shaftpose.network.shaft_network import ShaftNetwork


@pytest.fixture
def pose_coder() -> RegressionCoder:
    return RegressionCoder(low=(-20, -20, 10, 50, 0), high=(20, 20, 40, 90, 358))


@pytest.fixture
def bin_coder() -> BinCoder:
    """The bins of conf/variant/b.yaml over the ranges of params.yaml."""
    return BinCoder((-20, -20, 10, 50, 0), (20, 20, 40, 90, 358), steps=(1, 1, 1, 5, 5))


@pytest.fixture
def tiny_network(pose_coder: RegressionCoder) -> ShaftNetwork:
    torch.manual_seed(0)
    return ShaftNetwork(InceptionV4Features(0.1875, 0.25), ArchitectureD, pose_coder)
