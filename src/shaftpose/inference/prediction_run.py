"""A whole prediction: all frames of all sources, whatever happens to some of them."""

from collections.abc import Callable, Iterable

from shaftpose.errors import InputError
from shaftpose.inference.frames import Frame, Source
from shaftpose.inference.unwritable import UnwritableError


def for_each_frame(
    sources: Iterable[Source], work: Callable[[Frame], None], report: Callable[[str], None]
) -> int:
    """Do the work for all frames of all sources; returns how many sources failed.

    A source that cannot be read, or whose frame the work refuses by an InputError, is reported, and
    the next one follows. Raises UnwritableError from the work.
    """
    failed = 0
    for source in sources:
        try:
            for frame in source.frames():
                _do(work, frame)
        except UnwritableError:
            raise
        except InputError as error:
            failed += 1
            report(str(error))
    return failed


def _do(work: Callable[[Frame], None], frame: Frame) -> None:
    try:
        work(frame)
    except UnwritableError:
        raise
    except InputError as error:
        raise InputError(f"{frame.source}: {error}") from error
