"""A whole prediction: all frames of all sources, whatever happens to some of them."""

from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, TypeVar

from shaftpose.core.errors import InputError
from shaftpose.inference.frames import Origin
from shaftpose.inference.unwritable import UnwritableError

F = TypeVar("F", bound=Origin)
F_co = TypeVar("F_co", bound=Origin, covariant=True)


class FramesOf(Protocol[F_co]):
    """The part of a `Source` that a prediction needs, for frames of any type."""

    def frames(self) -> Iterator[F_co]:
        """The frames in their order. Raises InputError naming the source if it cannot be read."""


def for_each_frame(
    sources: Iterable[FramesOf[F]], work: Callable[[F], None], report: Callable[[str], None]
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


def _do(work: Callable[[F], None], frame: F) -> None:
    try:
        work(frame)
    except UnwritableError:
        raise
    except InputError as error:
        raise InputError(f"{frame.source}: {error}") from error
