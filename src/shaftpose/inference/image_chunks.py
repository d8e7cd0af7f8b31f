"""Prediction of many image files in chunks, spread over processes of one or more machines."""

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from uuid import uuid4

from shaftpose.core.errors import Warn
from shaftpose.frame_sources.frames import Source
from shaftpose.inference.chunk_worker import (
    Chunk,
    ChunkedRun,
    PredictedImage,
    Prediction,
    predict_chunk,
    versions,
)
from shaftpose.inference.loading import FinderOptions
from shaftpose.inference.model_files import checksum, model_file

_IMAGES = 16  # of a chunk: a second of work, milliseconds of overhead

# Does the work for all chunks and yields the results in order; None for a chunk whose processes
# have died.
Spread = Callable[
    [Callable[[Chunk], Prediction], Iterable[Chunk]], Iterator[tuple[Chunk, Prediction | None]]
]


def predicted_images(
    sources: Iterable[Source], options: FinderOptions, spread: Spread, warn: Warn
) -> Iterator[PredictedImage]:
    """Find the shafts in image files; yields the results in order.

    options: with absolute paths. warn: gets each distinct warning once. Raises InputError if other
    processes run other software than this one.
    """
    warned: set[str] = set()
    for prediction in _predictions(_chunks(sources, options), spread):
        for warning in prediction.warnings:
            if warning not in warned:
                warn(warning)
        warned.update(prediction.warnings)
        yield from prediction.images


def _predictions(chunks: Iterable[Chunk], spread: Spread) -> Iterator[Prediction]:
    """The results of all chunks. A chunk whose processes have died is repeated image by image, so
    that only the image that kills them is lost."""
    for chunk, prediction in spread(predict_chunk, chunks):
        if prediction is not None:
            yield prediction
        elif len(chunk.sources) == 1:
            yield Prediction((_lost(*chunk.sources),), ())
        else:
            for source in chunk.sources:
                yield from _predictions([Chunk((source,), chunk.run)], spread)


def _chunks(sources: Iterable[Source], options: FinderOptions) -> Iterator[Chunk]:
    with model_file(options.model) as path:
        model = checksum(path)
    software = versions(options.backend)
    rest, run = iter(sources), ChunkedRun(options, model, Path.cwd(), software, uuid4().hex)
    while images := tuple(islice(rest, _IMAGES)):
        yield Chunk(images, run)


def _lost(source: Source) -> PredictedImage:
    return PredictedImage(
        source.name,
        error=f"{source.name}: every process that looked for its shafts died; leave it out, or "
        "predict it alone without --workers to see how it ends",
    )
