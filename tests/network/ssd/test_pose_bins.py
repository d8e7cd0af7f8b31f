import math

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from shaftpose.core.errors import InputError
from shaftpose.network.ssd.pose_bins import BinCoder
from shaftpose.network.ssd.pose_coding import RegressionCoder

MIDDLE = [0.0, 0.0, 25.0, 70.0, 100.0]
X, Z, PITCH, YAW = 0, 2, 3, 4


def one_hot(coder: BinCoder, bins: Tensor) -> Tensor:
    """Bins (..., 5) -> logits (..., K), 10 for the bins and 0 for all others."""
    hot = [
        functional.one_hot(chosen, count)
        for chosen, count in zip(bins.unbind(-1), coder.bins, strict=True)
    ]
    return 10.0 * torch.cat(hot, dim=-1)


def bin_of(coder: BinCoder, dimension: int, value: float) -> int:
    pose = torch.tensor(MIDDLE)
    pose[dimension] = value
    return int(coder.encode(pose)[dimension])


def centre_of(coder: BinCoder, dimension: int, chosen: int) -> float:
    bins = torch.zeros(5, dtype=torch.long)
    bins[dimension] = chosen
    return float(coder.decode(one_hot(coder, bins))[dimension])


def test_as_many_logits_as_bins(bin_coder: BinCoder) -> None:
    assert bin_coder.bins == (40, 40, 30, 8, 72)  # 358 deg in steps of 5: the last bin overhangs
    assert bin_coder.values == 190


@pytest.mark.parametrize(
    ("dimension", "value", "expected"),
    [
        (X, -20.0, 0),  # the lower edge of the range
        (X, -19.01, 0),
        (X, -19.0, 1),  # an edge belongs to the bin above it
        (X, 0.0, 20),
        (X, 19.0, 39),
        (X, 20.0, 39),  # except the upper edge of the range
        (X, 25.0, 39),  # beyond the range: the outermost bin
        (X, -25.0, 0),
        (Z, 10.0, 0),
        (Z, 39.5, 29),
        (PITCH, 54.9, 0),
        (PITCH, 55.0, 1),
        (PITCH, 90.0, 7),
    ],
)
def test_bins_by_hand(bin_coder: BinCoder, dimension: int, value: float, expected: int) -> None:
    assert bin_of(bin_coder, dimension, value) == expected


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.0, 0), (4.9, 0), (5.0, 1), (354.9, 70), (355.0, 71), (358.0, 71), (359.9, 71), (360.0, 0),
     (362.0, 0), (-1.0, 71)],
)  # fmt: skip
def test_yaw_goes_around_the_circle(bin_coder: BinCoder, value: float, expected: int) -> None:
    assert bin_of(bin_coder, YAW, value) == expected


def test_yaw_goes_around_a_range_that_starts_elsewhere() -> None:
    coder = BinCoder((0, 0, 0, 0, -90), (1, 1, 1, 1, 90), steps=(1, 1, 1, 1, 45))
    assert [bin_of(coder, YAW, yaw) for yaw in (-90.0, 300.0, -1.0, 359.0, 1.0, 80.0)] == [
        0, 0, 1, 1, 2, 3
    ]  # fmt: skip
    assert [centre_of(coder, YAW, chosen) for chosen in range(4)] == [292.5, 337.5, 22.5, 67.5]


@pytest.mark.parametrize(
    ("dimension", "chosen", "centre"),
    [(X, 0, -19.5), (X, 20, 0.5), (X, 39, 19.5), (Z, 0, 10.5), (Z, 29, 39.5),
     (PITCH, 0, 52.5), (PITCH, 7, 87.5), (YAW, 0, 2.5), (YAW, 71, 357.5)],
)  # fmt: skip
def test_centres_by_hand(bin_coder: BinCoder, dimension: int, chosen: int, centre: float) -> None:
    assert centre_of(bin_coder, dimension, chosen) == centre


def test_a_step_that_is_no_binary_fraction_adds_no_bin() -> None:
    steps = (0.1, 0.1, 0.7, 0.7, 1.1)
    coder = BinCoder((0, 0.1, 0, 0.7, 0), (0.3, 0.7, 2.1, 2.8, 3.3), steps)
    assert coder.bins == (3, 6, 3, 3, 3)


def test_decode_undoes_encode_within_half_a_step(bin_coder: BinCoder) -> None:
    generator = torch.Generator().manual_seed(0)
    low, high = torch.tensor([-20.0, -20, 10, 50, 0]), torch.tensor([20.0, 20, 40, 90, 358])
    poses = low + (high - low) * torch.rand(4, 500, 5, generator=generator)
    poses = torch.cat([poses, low.expand(4, 1, 5), high.expand(4, 1, 5)], dim=1)
    decoded = bin_coder.decode(one_hot(bin_coder, bin_coder.encode(poses)))
    assert ((decoded - poses).abs() <= torch.tensor([0.5, 0.5, 0.5, 2.5, 2.5]) + 1e-4).all()
    assert ((decoded - poses).abs().amax(dim=(0, 1)) > torch.tensor([0.49] * 3 + [2.4] * 2)).all()


def test_cross_entropy_by_hand() -> None:
    coder = BinCoder((0,) * 5, (2,) * 5, steps=(1,) * 5)
    three = math.log(3)
    logits = torch.tensor([[0.0, three, 0.0, three, 0.0, 0.0, 50.0, 0.0, 0.0, 50.0]])
    poses = torch.tensor([[1.5, 0.5, 0.5, 0.5, 0.5]])
    expected = [math.log(4 / 3), math.log(4), math.log(2), 0.0, 50.0]
    errors = coder.errors(logits, poses, gamma=5.0)
    assert errors.shape == (1, 5)
    assert errors[0].tolist() == pytest.approx(expected, abs=1e-6)


def test_a_wrong_class_costs_the_same_however_far_it_is(bin_coder: BinCoder) -> None:
    """Also across the seam, where a regression's targets are farthest apart."""
    truth, far, near = torch.tensor([[MIDDLE] * 3]), torch.tensor(MIDDLE), torch.tensor(MIDDLE)
    truth[..., YAW], near[YAW], far[YAW] = 357.0, 1.0, 180.0
    answers = torch.stack([truth[0, 0], near, far])[None]
    errors = bin_coder.errors(one_hot(bin_coder, bin_coder.encode(answers)), truth, 1.0)[0, :, YAW]
    assert errors[1] == errors[2] > errors[0] + 9
    regression = RegressionCoder((-20, -20, 10, 50, 0), (20, 20, 40, 90, 358))
    numbers = regression.errors(regression.encode(answers), truth, 1.0)[0, :, YAW]
    assert numbers[1] > numbers[2] > 0


@pytest.mark.parametrize("steps", [(1, 1, 1, 5), (1, 1, 0, 5, 5)])
def test_wrong_steps_are_named(steps: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match=r"pose_coder.steps = \[1, 1, .*5\]: must be 5 numbers"):
        BinCoder((-20, -20, 10, 50, 0), (20, 20, 40, 90, 358), steps)
