"""Prediction of one chunk of images, perhaps by a process on another machine.

Such a process must run the same software and the same model.
"""

import hashlib
import os
import socket
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from threading import Lock

import cv2
import numpy as np
import onnxruntime

from shaftpose.core.errors import InputError, Warn
from shaftpose.frame_sources.frames import EmptyFolder, Frame, ImageFile, Source
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.loading import FinderOptions
from shaftpose.inference.model_files import checksum, model_file
from shaftpose.inference.prediction_run import for_each_frame
from shaftpose.inference.shaft_finder import ShaftFinder
from shaftpose.settings.choices import Backend
from shaftpose.source_code import source_files

Versions = tuple[tuple[str, str], ...]  # of packages, by name

_LOADING = Lock()  # a worker may have several threads


@dataclass(frozen=True)
class ChunkedRun:
    """Parameters shared by the chunks of one run.

    options: with absolute paths. model: checksum of its file. folder: base of relative paths of
    images. software: see `versions`. name: unique to the run.
    """

    options: FinderOptions
    model: bytes
    folder: Path
    software: Versions
    name: str


@dataclass(frozen=True)
class Chunk:
    """The images of one task."""

    sources: tuple[Source, ...]
    run: ChunkedRun


@dataclass(frozen=True)
class PredictedImage:
    """The shafts found in an image file, which is at once a source and its only frame.

    error: why the prediction failed; empty if it did not.
    """

    source: str
    shafts: tuple[FoundShaft, ...] = ()
    error: str = ""
    number: int = 0
    time_s: None = None

    def frames(self, warn: Warn) -> Iterator["PredictedImage"]:
        """Itself. Raises InputError if it failed."""
        if self.error:
            raise InputError(self.error)
        yield self


@dataclass(frozen=True)
class Prediction:
    """The result of a chunk.

    warnings: all distinct ones since the process loaded the model, sorted; earlier chunks of the
    run caused some of them.
    """

    images: tuple[PredictedImage, ...]
    warnings: tuple[str, ...]


def predict_chunk(chunk: Chunk) -> Prediction:
    """Find the shafts in the images of a chunk. The process loads the model once for a run.

    Raises InputError if the software differs or the model cannot be used.
    """
    own = versions(chunk.run.options.backend)
    if different := differences(own, chunk.run.software):
        raise InputError(
            f"{socket.gethostname()}: other software than on the machine that started the run: "
            f"{different}; install the same versions"
        )
    with _LOADING:
        finder, warnings = _finder(chunk.run)
    images = tuple(
        _predicted(source, chunk.run.folder, finder, warnings.add) for source in chunk.sources
    )
    return Prediction(images, tuple(sorted(warnings.copy())))


@lru_cache(maxsize=1)
def _finder(run: ChunkedRun) -> tuple[ShaftFinder, set[str]]:
    """A finder, and a set to which it adds its warnings.

    Raises InputError if the model cannot be used or is not the model of the run.
    """
    _check_model(run)
    os.environ.setdefault("ORT_INTRA_OP_NUM_THREADS", "1")  # each core has a process of its own
    warnings: set[str] = set()
    finder = run.options.finder(warnings.add)
    warnings.clear()  # the machine that started the run has warned of the options
    return finder, warnings


def _check_model(run: ChunkedRun) -> None:
    with model_file(run.options.model) as path:
        if not path.is_file() or checksum(path) != run.model:
            raise InputError(
                f"{socket.gethostname()}: {path}: missing, or differs from the model on the "
                "machine that started the run; name a file on a path that all machines share"
            )


def _predicted(source: Source, folder: Path, finder: ShaftFinder, warn: Warn) -> PredictedImage:
    if not isinstance(source, ImageFile | EmptyFolder):
        return PredictedImage(
            source.name,
            error=f"{source.name}: neither an image nor a folder of images; predict it without "
            "--workers",
        )
    found: list[FoundShaft] = []
    errors: list[str] = []
    image = replace(source, path=folder / source.path)

    def predict(frame: Frame) -> None:
        found.extend(finder(frame.rgb, source.name))

    for_each_frame([image], predict, errors.append, warn)
    return PredictedImage(source.name, tuple(found), "".join(errors))


@cache
def versions(backend: Backend) -> Versions:
    """Versions of the software that determines what is found in an image: of packages, `none` for
    one that is not installed, and for shaftpose a digest of the code that predicts a chunk."""
    code = hashlib.sha256()
    for path in source_files([__name__]):
        code.update(path.read_bytes())
    found = {"shaftpose": code.hexdigest()[:12]}
    found |= {package.__name__: package.__version__ for package in (onnxruntime, cv2, np)}
    if backend == "openvino":
        found["openvino"] = _installed("openvino")
    return tuple(found.items())


def differences(here: Versions, there: Versions) -> str:
    """The packages whose versions differ, as in `numpy 2.0.0 instead of 2.1.0`, or nothing."""
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
