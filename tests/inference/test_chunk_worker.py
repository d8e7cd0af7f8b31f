"""The software that determines what is found in an image."""

from pathlib import Path

import cv2
import onnxruntime
import pytest

from shaftpose.inference import chunk_worker
from shaftpose.inference.chunk_worker import differences, versions


def test_all_that_runs_a_model_is_named() -> None:
    found = dict(versions("onnxruntime"))
    assert found.keys() == {"shaftpose", "onnxruntime", "cv2", "numpy"}
    assert (found["onnxruntime"], found["cv2"]) == (onnxruntime.__version__, cv2.__version__)
    assert dict(versions("openvino")).keys() - found.keys() == {"openvino"}


def test_the_code_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    before = dict(versions("onnxruntime"))
    monkeypatch.setattr(chunk_worker, "source_files", lambda modules: [Path(__file__)])
    other = dict(versions.__wrapped__("onnxruntime"))
    assert {name for name in before if before[name] != other[name]} == {"shaftpose"}


def test_a_package_that_is_not_installed_has_no_version() -> None:
    assert chunk_worker._installed("no-such-package") == "none"


def test_differences_are_named() -> None:
    here, there = (("a", "1"), ("b", "2")), (("a", "1"), ("b", "3"), ("c", "4"))
    assert differences(here, here) == ""
    assert differences(here, there) == "b 2 instead of 3, c none instead of 4"
