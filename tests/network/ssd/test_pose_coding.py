import pytest
import torch

from shaftpose.network.ssd.pose_coding import RegressionCoder, smooth_l1


def test_values_by_hand(pose_coder: RegressionCoder) -> None:
    poses = torch.tensor([[20.0, -20.0, 25.0, 90.0, 179.0], [0.0, 10.0, 10.0, 60.0, 0.0]])
    expected = torch.tensor([[1.0, -1.0, 0.0, 1.0, 0.0], [0.0, 0.5, -1.0, -0.5, -1.0]])
    torch.testing.assert_close(pose_coder.encode(poses), expected)


def test_decode_undoes_encode(pose_coder: RegressionCoder) -> None:
    poses = torch.tensor([[[3.0, -7.0, 31.0, 72.0, 357.0]]])
    torch.testing.assert_close(pose_coder.decode(pose_coder.encode(poses)), poses)


@pytest.mark.parametrize(
    ("raw_deg", "wrapped_deg"), [(-10.0, 350.0), (361.0, 1.0), (360.0, 0.0), (-1e-6, 0.0)]
)
def test_decoded_yaw_is_wrapped(raw_deg: float, wrapped_deg: float) -> None:
    # Ranges of width 2 around 0 make codes and values the same number.
    coder = RegressionCoder((-1, -1, -1, -1, -1), (1, 1, 1, 1, 1))
    decoded = coder.decode(torch.tensor([0.0, 0.0, 0.0, 0.0, raw_deg]))
    assert decoded[4].item() == pytest.approx(wrapped_deg, abs=1e-4)
    assert decoded[4] < 360


def test_ranges_travel_with_the_weights(pose_coder: RegressionCoder) -> None:
    other = RegressionCoder((0,) * 5, (1,) * 5)
    other.load_state_dict(pose_coder.state_dict())
    assert other.high.tolist() == [20, 20, 40, 90, 358]


def test_smooth_l1_by_hand() -> None:
    errors = torch.tensor([[0.0, 0.5, -0.5], [1.0, -1.0, -3.0]])
    expected = torch.tensor([[0.0, 0.125, 0.125], [0.5, 0.5, 2.5]])
    torch.testing.assert_close(smooth_l1(errors), expected)
