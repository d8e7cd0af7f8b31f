"""A finished training's model in 8 bits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.shards import ShardedDataset
from shaftpose.deployment.predictor import Predictor
from shaftpose.errors import InputError
from studies import quantise
from studies.model_comparison import compare
from studies.quantise import eight_bit_model, too_much_lost
from tests.conftest import BOXES, POSES, SCORES, write_constant_model
from tests.studies.conftest import KEYS, comparison


@pytest.mark.parametrize(
    ("growth", "losses"),
    [
        ({}, []),
        (dict.fromkeys(quantise.ERRORS, 0.019), []),
        ({"x_mm": -0.1, "z_mm": 0.021}, ["z_mm grows by 2.1%"]),
        ({"yaw_deg": np.nan}, ["yaw_deg grows by nan%"]),
    ],
)
def test_errors_may_grow_by_two_percent(growth: dict[str, float], losses: list[str]) -> None:
    grown = comparison().growth | growth
    assert too_much_lost(comparison(growth=grown)) == losses


def test_rates_have_limits_of_their_own() -> None:
    own = comparison().exported
    worse = replace(own, mAP=0.894, detected_rate=0.88)
    assert too_much_lost(comparison(stored=worse)) == [
        "the mAP falls by 0.0060",
        "the detected rate falls from 0.9000 to 0.8800",
    ]
    assert too_much_lost(comparison(stored=replace(own, mAP=0.896, detected_rate=0.883))) == []


def test_growth_is_over_the_shafts_that_both_find(training: Path) -> None:
    """Errors of 0.5 mm in x become 1 mm."""
    moved = np.array(POSES)
    moved[0, 0] = 0.5  # the shafts are at 1.5 mm, the model says 1
    values = {"boxes": np.array(BOXES), "scores": np.array(SCORES), "poses": moved}
    other = write_constant_model(training / "other.onnx", values)
    shards = ShardedDataset(Path("data/render/images"))
    found = compare(Predictor(training / "model.onnx"), Predictor(other), shards, KEYS)
    assert found.growth["x_mm"] == pytest.approx(1.0)


def test_a_model_that_loses_too_much_is_not_kept(
    training: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def worse(model: Path, out: Path, images: np.ndarray) -> None:
        assert len(images) == len(KEYS)
        moved = np.array(POSES)
        moved[0, 0] = 0.5
        values = {"boxes": np.array(BOXES), "scores": np.array(SCORES), "poses": moved}
        write_constant_model(out, values)

    monkeypatch.setattr(quantise, "quantise", worse)
    with pytest.raises(
        InputError, match=r"model\.onnx: loses too much in 8 bits: x_mm grows by 100"
    ):
        eight_bit_model(training)
    assert not (training / "model_8bit.onnx").exists()
