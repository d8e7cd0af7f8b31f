"""Prediction of many image files in chunks, which processes of several machines can share."""

import os
import socket
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from threading import Lock
from uuid import uuid4

from shaftpose.core.errors import InputError
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.frames import EmptyFolder, ImageFile, Source
from shaftpose.inference.loading import FinderOptions
from shaftpose.inference.model_files import checksum, model_file
from shaftpose.inference.prediction_run import for_each_frame
from shaftpose.inference.shaft_finder import ShaftFinder
from shaftpose.inference.software import Versions, differences, versions
from shaftpose.inference.views import Warn

_IMAGES = 16  # of a chunk: a second of work, milliseconds of overhead
_LOADING = Lock()  # a worker may have several threads


@dataclass(frozen=True)
class ChunkedRun:
    """Parameters shared by the chunks of one run.

    options: with absolute paths. model: checksum of its file. folder: that the paths of images
    start from. software: see `software.versions`. name: no other run has it.
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
    """An image file with what was found in it: the only frame of itself.

    error: why it failed; empty if it did not.
    """

    source: str
    shafts: tuple[FoundShaft, ...] = ()
    error: str = ""
    number: int = 0
    fps: None = None

    def frames(self) -> Iterator["PredictedImage"]:
        """Itself. Raises InputError if it failed."""
        if self.error:
            raise InputError(self.error)
        yield self


@dataclass(frozen=True)
class Prediction:
    """The result of a chunk. warnings: those since the process loaded the model, each once, sorted;
    other chunks of the run have caused some of them."""

    images: tuple[PredictedImage, ...]
    warnings: tuple[str, ...]


# Does the work for all chunks, in their order. None: the processes that tried have died.
Spread = Callable[
    [Callable[[Chunk], Prediction], Iterable[Chunk]], Iterator[tuple[Chunk, Prediction | None]]
]


def predicted_images(
    sources: Iterable[Source], options: FinderOptions, spread: Spread, warn: Warn
) -> Iterator[PredictedImage]:
    """The image files with what was found in them, in their order.

    options: with absolute paths. warn: gets each warning once. Raises InputError if the processes
    do not have this one's software.
    """
    warned: set[str] = set()
    for prediction in _predictions(_chunks(sources, options), spread):
        for warning in prediction.warnings:
            if warning not in warned:
                warn(warning)
        warned.update(prediction.warnings)
        yield from prediction.images


def _predictions(chunks: Iterable[Chunk], spread: Spread) -> Iterator[Prediction]:
    """The results of all chunks; an image that no process survives costs none but itself."""
    for chunk, prediction in spread(predict_chunk, chunks):
        if prediction is not None:
            yield prediction
        elif len(chunk.sources) == 1:
            yield Prediction((_lost(*chunk.sources),), ())
        else:
            for source in chunk.sources:
                yield from _predictions([Chunk((source,), chunk.run)], spread)


def predict_chunk(chunk: Chunk) -> Prediction:
    """Predict the images of a chunk, with a model that this process loads once in a run.

    Raises InputError if the software differs or the model cannot be used.
    """
    own = versions(chunk.run.options.backend, __name__)
    if different := differences(own, chunk.run.software):
        raise InputError(
            f"{socket.gethostname()}: other software than on the machine that started the run: "
            f"{different}; install the same versions"
        )
    with _LOADING:
        finder, warnings = _finder(chunk.run)
    images = tuple(_predicted(source, chunk.run.folder, finder) for source in chunk.sources)
    return Prediction(images, tuple(sorted(warnings.copy())))


def _chunks(sources: Iterable[Source], options: FinderOptions) -> Iterator[Chunk]:
    with model_file(options.model) as path:
        model = checksum(path)
    software = versions(options.backend, __name__)
    rest, run = iter(sources), ChunkedRun(options, model, Path.cwd(), software, uuid4().hex)
    while images := tuple(islice(rest, _IMAGES)):
        yield Chunk(images, run)


@lru_cache(maxsize=1)
def _finder(run: ChunkedRun) -> tuple[ShaftFinder, set[str]]:
    """A finder, and a set to which it adds its warnings.

    Raises InputError if the model cannot be used or is not that of the run.
    """
    _check_model(run)
    os.environ.setdefault("ORT_INTRA_OP_NUM_THREADS", "1")  # each core has a process of its own
    warnings: set[str] = set()
    finder = run.options.finder(warnings.add)
    warnings.clear()  # whoever has started the run was warned of the options themselves
    return finder, warnings


def _check_model(run: ChunkedRun) -> None:
    with model_file(run.options.model) as path:
        if not path.is_file() or checksum(path) != run.model:
            raise InputError(
                f"{socket.gethostname()}: {path}: missing, or differs from the model on the "
                "machine that started the run; name a file on a path that all machines share"
            )


def _predicted(source: Source, folder: Path, finder: ShaftFinder) -> PredictedImage:
    if not isinstance(source, ImageFile | EmptyFolder):
        return PredictedImage(
            source.name,
            error=f"{source.name}: neither an image nor a folder of images; predict it without "
            "--workers",
        )
    found: list[FoundShaft] = []
    errors: list[str] = []
    image = replace(source, path=folder / source.path)
    for_each_frame([image], lambda frame: found.extend(finder(frame.rgb)), errors.append)
    return PredictedImage(source.name, tuple(found), "".join(errors))


def _lost(source: Source) -> PredictedImage:
    return PredictedImage(
        source.name,
        error=f"{source.name}: every process that predicted it died (out of memory?); predict it "
        "without --workers",
    )
