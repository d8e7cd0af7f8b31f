"""Averages of a training with the training that it started from."""

from dataclasses import asdict, replace
from pathlib import Path

import pytest
import torch

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_json
from shaftpose.stage_files import read_training
from shaftpose.training.fingerprint import start_digest
from studies.average_trainings import average
from tests.evaluations import TRAINING


def write(folder: Path, weight: float, steps: int, start: str | None) -> Path:
    """The folder of a training whose network has a weight, an edge reader's and a counter."""
    folder.mkdir()
    state = {
        "network.a": torch.tensor([weight]),
        "network.edges.b": torch.tensor([weight]),
        "network.steps": torch.tensor(steps),
    }
    torch.save({"identity": {"variant": "e"}, "state_dict": state}, folder / "model.ckpt")
    (folder / "curves.csv").write_text(f"step,name,value\n{steps},validation/mAP,0.5\n")
    record = replace(TRAINING, steps=steps, data=replace(TRAINING.data, start=start))
    write_json(folder / "training.json", asdict(record))
    return folder


@pytest.fixture
def before(tmp_path: Path) -> Path:
    """The earlier training."""
    return write(tmp_path / "before", 1.0, 30, None)


@pytest.fixture
def after(before: Path) -> Path:
    """A training that started from it."""
    return write(before.parent / "after", 3.0, 20, start_digest(before / "model.ckpt"))


@pytest.mark.parametrize(("share", "weight"), [(0.5, 2.0), (0.25, 1.5)])
def test_weights_lie_between_both(before: Path, after: Path, share: float, weight: float) -> None:
    out = before.parent / "out"
    average(before, after, out, share)
    checkpoint = torch.load(out / "model.ckpt", weights_only=True)
    assert checkpoint["state_dict"]["network.a"].tolist() == [weight]
    assert checkpoint["state_dict"]["network.edges.b"].tolist() == [3.0]
    assert checkpoint["state_dict"]["network.steps"].item() == 20
    assert checkpoint["identity"] == {"variant": "e"}
    assert (out / "curves.csv").read_text() == (after / "curves.csv").read_text()
    record, of_after = read_training(out), read_training(after)
    assert record.variant == {**of_after.variant, "average_share": share}
    assert record.training_id != of_after.training_id
    assert replace(record, training_id=of_after.training_id, variant=of_after.variant) == of_after


def test_trainings_without_a_common_start_are_refused(before: Path, after: Path) -> None:
    with pytest.raises(
        InputError, match=r"before: did not start from the same .*after/model\.ckpt"
    ):
        average(after, before, before.parent / "out")
    assert not (before.parent / "out").exists()


def test_a_detector_that_a_variant_started_from_is_refused(before: Path, after: Path) -> None:
    checkpoint = torch.load(after / "model.ckpt", weights_only=True)
    torch.save({**checkpoint, "identity": {"variant": "d"}}, after / "model.ckpt")
    with pytest.raises(InputError, match="after: did not start from the same network in"):
        average(before, after, before.parent / "out")


def test_neither_training_is_overwritten(before: Path, after: Path) -> None:
    with pytest.raises(InputError, match="--out .*after: holds one of both trainings; name"):
        average(before, after, after)


@pytest.mark.parametrize("share", [0.0, 1.0, -0.1])
def test_a_share_that_leaves_one_out_is_refused(before: Path, after: Path, share: float) -> None:
    with pytest.raises(InputError, match=rf"--share {share}: give a number between 0 and 1"):
        average(before, after, before.parent / "out", share)
