"""A model for a user's frames, in Python."""

import logging
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.core.images import read_rgb
from shaftpose.errors import InputError
from shaftpose.inference.loading import load

ROOT = Path(__file__).parents[2]
FRAME = ROOT / "src/shaftpose/inference/demo_frame.jpg"


def test_what_is_known_is_metric(caplog: pytest.LogCaptureFixture) -> None:
    known = load(view_deg=95.0, diameter_mm=3.0)(read_rgb(FRAME))
    assert not caplog.text
    assert len(known) == 2 and all(shaft.metric for shaft in known)
    thicker = load(view_deg=95.0, diameter_mm=6.0)(read_rgb(FRAME))
    for one, twice in zip(known, thicker, strict=True):
        assert twice.pose.z_mm == pytest.approx(2 * one.pose.z_mm)
        np.testing.assert_allclose(twice.tip_px, one.tip_px)


def test_what_is_unknown_is_said(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        shafts = load()(read_rgb(FRAME))
    assert "MILLIMETRES ARE NOT METRIC" in caplog.text
    assert not any(shaft.metric for shaft in shafts)


def test_a_model_that_is_not_there_is_named() -> None:
    with pytest.raises(InputError, match=r"nowhere\.onnx"):
        load("nowhere.onnx")


def test_the_readmes_lines_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert lines is not None
    large = cv2.resize(cv2.imread(str(FRAME)), (640, 640), interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(tmp_path / "frame.png"), large)
    monkeypatch.chdir(tmp_path)
    exec(lines[1], {})
    assert "ShaftPose(" in capsys.readouterr().out
