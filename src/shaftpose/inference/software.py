"""The software that determines what is found in an image."""

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version

import cv2
import numpy as np
import onnxruntime

from shaftpose.settings.choices import Backend
from shaftpose.source_code import source_files

Versions = tuple[tuple[str, str], ...]  # of packages, by name


@cache
def versions(backend: Backend, module: str) -> Versions:
    """The versions of the packages that run a model, `none` for one that is not installed, and for
    shaftpose a digest of the files that a module depends on."""
    code = hashlib.sha256()
    for path in source_files([module]):
        code.update(path.read_bytes())
    found = {"shaftpose": code.hexdigest()[:12]}
    found |= {package.__name__: package.__version__ for package in (onnxruntime, cv2, np)}
    if backend == "openvino":
        found["openvino"] = _installed("openvino")
    return tuple(found.items())


def differences(here: Versions, there: Versions) -> str:
    """The packages of different versions, as `numpy 2.0.0 instead of 2.1.0`; empty if none are."""
    own, others = dict(here), dict(there)
    return ", ".join(
        f"{name} {own.get(name, 'none')} instead of {others.get(name, 'none')}"
        for name in sorted({*own, *others})
        if own.get(name) != others.get(name)
    )


def _installed(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"
