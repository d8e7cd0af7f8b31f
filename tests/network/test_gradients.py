"""The layout of gradients in memory."""

import torch

from shaftpose.network.gradients import with_packed_gradient


def test_slices_of_a_gradient_are_packed() -> None:
    """A concatenation passes each of its parts a slice of its gradient."""
    x, other = (torch.zeros(2, 3, 4, 5, requires_grad=True) for _ in range(2))
    doubled = with_packed_gradient(2 * x)
    gradients = list[torch.Tensor]()
    doubled.register_hook(gradients.append)
    weights = torch.arange(2 * 6 * 4 * 5.0).view(2, 6, 4, 5)
    weights = weights.contiguous(memory_format=torch.channels_last)
    torch.cat([doubled, other], dim=1).backward(weights)
    assert torch.equal(gradients[0], weights[:, :3])
    assert gradients[0].is_contiguous(memory_format=torch.channels_last)
    assert not weights[:, :3].is_contiguous(memory_format=torch.channels_last)
    assert x.grad is not None and torch.equal(x.grad, 2 * weights[:, :3])


def test_without_a_gradient_nothing_is_done() -> None:
    x = torch.zeros(1, 1, 2, 2)
    assert with_packed_gradient(x) is x
