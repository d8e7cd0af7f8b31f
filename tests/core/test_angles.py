import numpy as np
import pytest

from shaftpose.core.angles import signed_deg, unsigned_deg


@pytest.mark.parametrize(
    ("angle_deg", "signed", "unsigned"),
    [(0.0, 0.0, 0.0), (179.0, 179.0, 179.0), (180.0, -180.0, 180.0), (-180.0, -180.0, 180.0),
     (359.0, -1.0, 359.0), (-10.0, -10.0, 350.0), (725.0, 5.0, 5.0), (-1e-15, 0.0, 0.0)],
)  # fmt: skip
def test_angles_by_hand(angle_deg: float, signed: float, unsigned: float) -> None:
    assert signed_deg(angle_deg) == signed
    assert unsigned_deg(angle_deg) == unsigned


def test_all_angles_of_an_array_are_wrapped() -> None:
    angles = np.array([[-90.0, 270.0], [360.0, 540.0]])
    assert signed_deg(angles).tolist() == [[-90.0, -90.0], [0.0, -180.0]]
    assert unsigned_deg(angles).tolist() == [[270.0, 270.0], [0.0, 180.0]]
