"""The software that determines what is found."""

import cv2
import onnxruntime

from shaftpose.inference import software
from shaftpose.inference.software import differences, versions

MODULE = "shaftpose.inference.image_chunks"


def test_all_that_runs_a_model_is_named() -> None:
    found = dict(versions("onnxruntime", MODULE))
    assert found.keys() == {"shaftpose", "onnxruntime", "cv2", "numpy"}
    assert (found["onnxruntime"], found["cv2"]) == (onnxruntime.__version__, cv2.__version__)
    assert dict(versions("openvino", MODULE)).keys() - found.keys() == {"openvino"}


def test_the_code_counts() -> None:
    before = dict(versions("onnxruntime", MODULE))
    other = dict(versions("onnxruntime", "shaftpose.inference.tracks"))
    assert {name for name in before if before[name] != other[name]} == {"shaftpose"}


def test_a_package_that_is_not_installed_has_no_version() -> None:
    assert software._installed("no-such-package") == "none"


def test_differences_are_named() -> None:
    here, there = (("a", "1"), ("b", "2")), (("a", "1"), ("b", "3"), ("c", "4"))
    assert differences(here, here) == ""
    assert differences(here, there) == "b 2 instead of 3, c none instead of 4"
