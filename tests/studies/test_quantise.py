"""A finished training's model in 8 bits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.metrics.pose_errors import errors_between
from studies import quantise
from studies.model_comparison import growth_between
from studies.quantise import eight_bit_model, too_much_lost
from tests.conftest import BOXES, POSES, SCORES, write_constant_model
from tests.studies.conftest import KEYS, comparison

# The exported model predicts x = 1 mm for shafts at 1.5 mm: an error of 0.5.
ERR_0505, ERR_1 = 0.995, 0.5  # x that errs by 0.505 and by 1 mm


@pytest.mark.parametrize(
    ("growth", "losses"),
    [
        ({}, []),
        (dict.fromkeys(POSE_DIMENSIONS, 0.019), []),
        ({"x_mm": -0.1, "z_mm": 0.021}, ["z_mm grows by 2.1%"]),
        ({"yaw_deg": np.nan}, ["yaw_deg grows by nan%"]),
    ],
)
def test_errors_may_grow_by_two_percent(growth: dict[str, float], losses: list[str]) -> None:
    grown = comparison().growth | growth
    assert too_much_lost(comparison(growth=grown)) == losses


def test_rates_have_limits_of_their_own() -> None:
    own = comparison().exported
    worse = {**own, "mAP": 0.894, "detected_rate": 0.88}
    assert too_much_lost(comparison(stored=worse)) == [
        "the mAP falls by 0.0060",
        "the detected rate falls from 0.9000 to 0.8800",
    ]
    assert too_much_lost(comparison(stored={**own, "mAP": 0.896, "detected_rate": 0.883})) == []


def test_growth_is_over_the_shafts_that_both_find() -> None:
    """Errors of 0.1 and 0.2 mm in x become 0.3 mm; a third shaft, 9 mm off, is found no more."""
    true = np.tile([1.0, 0.0, 20.0, 70.0, 10.0], (3, 1))
    x = np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    before = errors_between(true + np.array([[0.1], [9.0], [0.2]]) * x, true)
    after = errors_between(true[:2] + 0.3 * x, true[:2])
    after = replace(after, instruments=np.array([0, 2]))
    assert growth_between(before, after)["x_mm"] == pytest.approx(1.0)


@pytest.fixture
def another(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the copy in 8 bits predicts for x, in place of the quantizer's own rounding."""
    x_mm: list[float] = []

    def write(model: Path, out: Path, images: np.ndarray) -> None:
        assert len(images) == len(KEYS)
        poses = np.array(POSES)
        poses[0, 0] = x_mm[0]
        values = {"boxes": np.array(BOXES), "scores": np.array(SCORES), "poses": poses}
        write_constant_model(out, values)

    monkeypatch.setattr(quantise, "quantise", write)
    return x_mm


def test_a_copy_that_is_as_good_is_kept(
    training: Path,
    another: list[float],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(quantise, "POSE_DIMENSIONS", ("x_mm",))  # the others have no error
    another.append(ERR_0505)
    assert eight_bit_model(training) == training / "model_8bit.onnx"
    assert (training / "model_8bit.onnx").is_file()
    assert "errors over the shafts that both find grow by x_mm +1.0%\n" in capsys.readouterr().out


def test_a_copy_that_loses_too_much_leaves_the_earlier_one(
    training: Path, another: list[float]
) -> None:
    (training / "model_8bit.onnx").write_text("earlier")
    another.append(ERR_1)
    message = r"/model\.onnx: loses too much in 8 bits: x_mm grows by 100"
    with pytest.raises(InputError, match=message):
        eight_bit_model(training)
    assert (training / "model_8bit.onnx").read_text() == "earlier"
    assert not list(training.glob("*.part"))


def test_a_training_that_is_not_exported_is_named(training: Path) -> None:
    (training / "model.onnx").unlink()
    with pytest.raises(InputError, match=r"/model\.onnx: no such file; export it"):
        eight_bit_model(training)
