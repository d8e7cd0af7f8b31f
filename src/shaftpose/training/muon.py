"""Muon (Jordan et al., 2024): steps along the orthogonalised momentum of a weight matrix.

`torch.optim.Muon` refuses convolutions, and Lightning's loop takes one optimiser for all weights,
so this one updates the other weights by Adam.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable

import torch
from torch import Tensor
from torch.nn import Parameter

_ITERATIONS = 5
# Coefficients of the quintic polynomial that brings singular values near 1 in few iterations.
_A, _B, _C = 3.4445, -4.7750, 2.0315


class Muon(torch.optim.Optimizer):
    """Muon for `matrices`, Adam for `others`.

    A convolution (out, in, k, k) is treated as the matrix (out, in k k). The length of a step along
    every singular direction of the momentum is about `learning_rate` sqrt(max(1, rows / columns)).
    """

    def __init__(
        self,
        matrices: Iterable[Parameter],
        others: Iterable[Parameter],
        learning_rate: float,
        adam_learning_rate: float,
        momentum: float = 0.95,
        fused: bool = True,
    ) -> None:
        self._adam = torch.optim.Adam(others, lr=adam_learning_rate, fused=fused)
        group = {"params": list(matrices), "lr": learning_rate, "momentum": momentum}
        super().__init__([group, *self._adam.param_groups], defaults={})

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> float | None:  # type: ignore[override]
        """Update all weights that have a gradient; return the closure's loss, if any."""
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        group, *rest = self.param_groups
        self._step_matrices(group)
        # Loading a checkpoint replaces groups and state.
        self._adam.param_groups, self._adam.state = rest, self.state
        self._adam.step()
        return loss

    def _step_matrices(self, group: dict) -> None:
        by_shape: dict[tuple[int, int], list[Parameter]] = defaultdict(list)
        for weight in group["params"]:
            if weight.grad is not None:
                by_shape[len(weight), weight[0].numel()].append(weight)
        for (rows, columns), weights in by_shape.items():
            momenta = torch.stack([self._momentum(w, group["momentum"]) for w in weights])
            length = group["lr"] * max(1.0, rows / columns) ** 0.5
            for weight, direction in zip(weights, orthogonalised(momenta), strict=True):
                weight.sub_(direction.view(weight.shape), alpha=length)

    def _momentum(self, weight: Parameter, momentum: float) -> Tensor:
        """(rows, columns) Nesterov's momentum of a weight's gradient."""
        assert weight.grad is not None
        gradient = weight.grad.flatten(1)
        state = self.state[weight]
        if "momentum" not in state:
            state["momentum"] = torch.zeros_like(gradient)
        average: Tensor = state["momentum"].lerp_(gradient, 1 - momentum)
        return gradient.lerp(average, momentum)


def orthogonalised(matrices: Tensor) -> Tensor:
    """(N, rows, columns) -> the same singular vectors with singular values near 1.

    Uses the Newton-Schulz iteration. Values above 0.0015 of a matrix's norm end in 0.68..1.21;
    smaller ones grow, but stay below.
    """
    tall = matrices.shape[1] > matrices.shape[2]
    x = matrices.mT if tall else matrices
    x = x / x.norm(dim=(1, 2), keepdim=True).clamp(min=1e-7)
    for _ in range(_ITERATIONS):
        gram = x @ x.mT
        x = _A * x + (_B * gram + _C * gram @ gram) @ x
    return x.mT if tall else x
