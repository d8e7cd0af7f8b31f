"""Muon against singular value decompositions, torch's own Muon, and Adam."""

from copy import deepcopy

import pytest
import torch
from torch import Tensor
from torch.nn import Parameter

from shaftpose.training.muon import Muon, orthogonalised


def random(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("shape", [(3, 8, 20), (2, 20, 8), (1, 12, 12)])
def test_singular_values_come_near_one_and_directions_stay(shape: tuple[int, int, int]) -> None:
    matrices = random(*shape)
    result = orthogonalised(matrices)
    assert result.shape == matrices.shape
    values = torch.linalg.svdvals(result)
    assert values.min() > 0.6 and values.max() < 1.3
    u, s, v = torch.linalg.svd(matrices, full_matrices=False)
    inside = u.mT @ result @ v.mT  # diagonal if the singular vectors are the same
    assert (inside - torch.diag_embed(inside.diagonal(dim1=1, dim2=2))).abs().max() < 1e-4


def test_a_matrix_moves_as_with_torchs_own_muon() -> None:
    """Not exactly: torch's Muon computes in bfloat16."""
    start, gradients = random(6, 10), [random(6, 10, seed=n) for n in (1, 2, 3)]
    ours, theirs = Parameter(start.clone()), Parameter(start.clone())
    mine = Muon([ours], [Parameter(torch.zeros(1))], 0.02, 0.001)
    other = torch.optim.Muon([theirs], lr=0.02, weight_decay=0.0, adjust_lr_fn="original")
    for gradient in gradients:
        ours.grad, theirs.grad = gradient.clone(), gradient.clone()
        mine.step()
        other.step()
    moved = (ours - start).norm()
    assert (ours - theirs).norm() < 0.03 * moved


def test_a_convolution_counts_as_the_matrix_of_its_outputs() -> None:
    kernel, flat = Parameter(random(6, 5, 3, 3)), Parameter(random(6, 5, 3, 3).flatten(1))
    kernel.data = kernel.data.to(memory_format=torch.channels_last)
    gradient = random(6, 5, 3, 3, seed=4)
    kernel.grad, flat.grad = gradient.to(memory_format=torch.channels_last), gradient.flatten(1)
    Muon([kernel, flat], [Parameter(torch.zeros(1))], 0.1, 0.001).step()
    torch.testing.assert_close(kernel.detach().flatten(1), flat.detach())


def test_tall_matrices_step_further() -> None:
    """The factor is the square root of rows / columns, 2 for 16 x 4."""
    tall, wide = Parameter(torch.zeros(16, 4)), Parameter(torch.zeros(4, 16))
    gradient = random(16, 4)
    tall.grad, wide.grad = gradient, gradient.mT.contiguous()
    Muon([tall, wide], [Parameter(torch.zeros(1))], 0.1, 0.001).step()
    torch.testing.assert_close(tall.detach(), 2 * wide.detach().mT)


def test_others_move_as_with_adam_and_unused_weights_stay() -> None:
    start = random(7)
    ours, theirs = Parameter(start.clone()), Parameter(start.clone())
    unused = Parameter(random(3, 3))
    mine = Muon([unused], [ours], 0.02, 0.001)
    adam = torch.optim.Adam([theirs], lr=0.001)
    for seed in (1, 2):
        ours.grad, theirs.grad = random(7, seed=seed), random(7, seed=seed)
        mine.step()
        adam.step()
    torch.testing.assert_close(ours, theirs)
    assert torch.equal(unused, random(3, 3))


def test_a_restored_state_goes_on_as_the_original() -> None:
    def step(optimizer: Muon, weights: list[Parameter], seed: int) -> None:
        for weight in weights:
            weight.grad = random(*weight.shape, seed=seed)
        optimizer.step()

    weights = [Parameter(random(4, 6)), Parameter(random(5))]
    first = Muon(weights[:1], weights[1:], 0.02, 0.001)
    step(first, weights, 1)
    copies = [Parameter(weight.detach().clone()) for weight in weights]
    second = Muon(copies[:1], copies[1:], 0.5, 0.5)
    second.load_state_dict(deepcopy(first.state_dict()))
    step(first, weights, 2)
    step(second, copies, 2)
    for weight, copy in zip(weights, copies, strict=True):
        assert torch.equal(weight, copy)
