"""The benchmark from large frames to poses, in miniature."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import backends, inference, soak


def test_each_model_and_refinement_has_its_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inference, "ROUNDS", 1)
    monkeypatch.setattr(inference, "PER_ROUND", 1)
    monkeypatch.setattr(inference, "STARTS", 1)
    monkeypatch.setattr(inference, "MORE_FRAMES", 1)
    monkeypatch.setattr(inference, "bundled_names", lambda: ["shaftpose"])
    monkeypatch.setattr(inference, "get_args", lambda _: ("none", "edges"))
    monkeypatch.setattr(inference, "ROOT", tmp_path)
    monkeypatch.setattr(inference, "OUT", tmp_path / "inference.json")
    monkeypatch.setenv("PYTHONPATH", str(Path(inference.__file__).parents[1]))
    inference.main()
    result = json.loads((tmp_path / "inference.json").read_text())
    assert [row["refine"] for row in result["models"]] == ["none", "edges"]
    for row in result["models"]:
        assert row["fps_median"] > 0 and row["ms_p95"] > 0
        assert 0 < row["cold_start_s"] < 60 and 50 < row["rss_mib"] < 4000


def test_memory_is_compared_with_that_after_the_first_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["soak", "--frames", "3"])
    monkeypatch.setattr(soak, "ROOT", tmp_path)
    monkeypatch.setattr(soak, "OUT", tmp_path / "soak.json")
    monkeypatch.setattr(soak, "SETTLED", 1)
    soak.main()
    result = json.loads((tmp_path / "soak.json").read_text())
    assert (result["frames"], result["settled"]) == (3, 1)
    assert 0.5 < 1 + result["rss_growth"] < 2


def test_the_film_fills_large_frames() -> None:
    frame = next(inference.frames())
    assert frame.shape == (1080, 1920, 3)
    assert min(part.mean() for part in np.array_split(frame, 8, axis=1)) > 20
    assert abs(inference.VIEW_DEG - 63.1) < 0.05


def test_each_backend_has_its_speed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backends, "ROUNDS", 1)
    monkeypatch.setattr(backends, "PER_ROUND", 1)
    monkeypatch.setattr(backends, "PROFILE", "smoke")
    monkeypatch.setattr(backends, "OUT", tmp_path / "backends.json")
    backends.main()
    rows = json.loads((tmp_path / "backends.json").read_text())["backends"]
    measured = {(row["network"], row["run by"]) for row in rows}
    assert ("default", "onnxruntime, 8 bits") in measured
    assert ("D, width 0.1875, depth 0.25", "PyTorch, 32 bits") in measured
    assert all(row["fps_median"] > 0 for row in rows)
