"""A distributed training gives the same result as a single process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from tests.training import rank_process


def test_two_processes_train_like_one(tmp_path: Path) -> None:
    expected = rank_process.train(1, tmp_path)
    command = [sys.executable, str(Path(rank_process.__file__)), "2", str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    seen = torch.load(tmp_path / "seen.pt", weights_only=True)
    gradient = expected["gradient"]
    assert gradient.norm() > 1
    torch.testing.assert_close(seen["gradient"], gradient, rtol=1e-3, atol=1e-5)
    found = {(step, name): value for step, name, value in seen["rows"]}
    known = {(step, name): value for step, name, value in expected["rows"]}
    assert found.keys() == known.keys()
    assert {name for _, name in known} >= {"train/loss", "train/matched", "validation/loss"}
    assert found == pytest.approx(known, rel=1e-3)
