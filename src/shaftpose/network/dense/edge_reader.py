"""E's edge reader: finds the outline of a shaft near a supposed one, and how sure it is of it.

It reads strips of the image along the supposed outline (`refinement.contour_sampling`). Edges of
highlights inside the metal, of shadows and of other shafts are often stronger than the outline: the
reader learns which edge is meant.
"""

import torch
from torch import Tensor, nn

from shaftpose.network.dense.edge_samples import EdgeSamples
from shaftpose.network.dense.residual import Residual, conv_norm_relu
from shaftpose.network.smooth_l1 import smooth_l1
from shaftpose.refinement.contour_sampling import COLUMNS, MIDDLE

_FINE, _CHANNELS = 16, 64
_KERNEL, _DILATIONS = (5, 1), (1, 2, 4, 8)  # along the outline
_LOG_SCALES = (-4.0, 3.0)
_PLAIN = 0.1  # weight of the loss that does not depend on the scales


class EdgeReader(nn.Module):
    """Two convolutions on the strip, then, with the columns as channels, convolutions along it."""

    def __init__(self) -> None:
        super().__init__()
        self.fine = nn.Sequential(
            *conv_norm_relu(3, _FINE),
            *conv_norm_relu(_FINE, _FINE, stride=(1, 2)),
            *conv_norm_relu(_FINE, _CHANNELS, (1, (COLUMNS + 1) // 2), padded=False),
        )
        self.along = nn.Sequential(
            *(Residual(_CHANNELS, _KERNEL, (dilation, 1)) for dilation in _DILATIONS)
        )
        self.values = nn.Conv2d(_CHANNELS, 2, 1)

    def forward(self, strips: Tensor) -> tuple[Tensor, Tensor]:
        """(M, 3, ROWS, COLUMNS) in [-1, 1] -> offsets (M, ROWS) of the outline, in columns from
        the middle one, and the logarithms (M, ROWS) of the mean errors of these offsets."""
        offsets, log_scales = self.values(self.along(self.fine(strips)))[..., 0].unbind(1)
        return MIDDLE * torch.tanh(offsets / MIDDLE), log_scales.clamp(*_LOG_SCALES)

    def loss(self, samples: EdgeSamples) -> Tensor:
        """Negative log-likelihood of Laplace distributions, plus a share of smooth L1; scalar."""
        offsets, log_scales = self(samples.colours)
        errors = (offsets.float() - samples.offsets).abs()
        plain = smooth_l1(errors)
        losses = errors * torch.exp(-log_scales.float()) + log_scales.float() + _PLAIN * plain
        return (losses * samples.known).sum() / samples.known.sum().clamp(min=1)
