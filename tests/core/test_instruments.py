import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.instruments import unpadded


def test_padding_is_removed_image_by_image_in_double_precision() -> None:
    scores = np.array([[0.75, 0.5, 0.0], [0.0, 0.0, 0.0]], dtype=np.float32)
    boxes = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    poses = np.arange(30, dtype=np.float32).reshape(2, 3, 5)
    found, nothing = unpadded(boxes, scores, poses)
    assert found.scores.tolist() == [0.75, 0.5]
    assert found.boxes.tolist() == boxes[0, :2].tolist()
    assert found.poses.tolist() == poses[0, :2].tolist()
    assert nothing.boxes.shape == (0, 4) and nothing.poses.shape == (0, 5)
    assert {values.dtype for one in (found, nothing) for values in vars(one).values()} == {
        np.dtype(np.float64)
    }


@pytest.mark.parametrize("spoilt", ["boxes", "scores", "poses"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(spoilt: str, value: float) -> None:
    outputs = {"boxes": np.ones((2, 3, 4)), "scores": np.ones((2, 3)), "poses": np.ones((2, 3, 5))}
    outputs[spoilt][1, 2] = value
    with pytest.raises(InputError, match="not finite"):
        unpadded(**outputs)
