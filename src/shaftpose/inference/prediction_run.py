"""A prediction run: the sources that the user names, the loop over their frames, the outputs."""

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Protocol, TypeVar
from urllib.parse import urlsplit
from urllib.request import url2pathname

from shaftpose.core.errors import InputError, Warn
from shaftpose.frame_sources.frames import Frame, FrameId, Source, images_of
from shaftpose.frame_sources.live_streams import LiveStream
from shaftpose.frame_sources.video_files import Span
from shaftpose.frame_sources.web_addresses import WebAddress, file_source
from shaftpose.inference.annotated_files import AnnotatedFiles
from shaftpose.inference.formats import Format
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.result_stream import UnwritableError, result_stream

# Writes a frame with its shafts.
Write = Callable[[Frame, Sequence[FoundShaft]], None]
_log = logging.getLogger(__name__)
_MOST_DIGITS = 4  # of the number of a camera
F = TypeVar("F", bound=FrameId)
F_co = TypeVar("F_co", bound=FrameId, covariant=True)


def sources(
    names: Iterable[str],
    lines: Iterable[str],
    span: Span,
    warn: Warn = _log.warning,
    drawings: Path | None = None,
) -> Iterator[Source]:
    """The sources with these names, in order; `-` stands for the names on `lines`, which are read
    one at a time. span: the part of films that is wanted. warn: is told of films in folders,
    and of a span that folders ignore. drawings: the folder that drawings go to, if any. Raises
    InputError if it is a source, too: drawings would be taken for images."""
    for name in names:
        if name == "-":
            for line in lines:
                # Lists that were written on Windows may begin with a byte order mark.
                if written := line.rstrip("\r\n").removeprefix("\ufeff"):
                    yield from _named(written, span, warn, drawings)
        else:
            yield from _named(name, span, warn, drawings)


def _named(name: str, span: Span, warn: Warn, drawings: Path | None) -> Iterable[Source]:
    """A whole number is a camera, a name with `://` an address; all others are paths."""
    if is_live(name):
        if span != Span():
            warn(f"{name}: --start, --end, --every: for films alone; they change nothing here")
        return [LiveStream(int(name) if _is_camera(name) else name)]
    scheme, separator, _ = name.partition("://")
    if separator and scheme.lower() != "file":
        return [WebAddress(name, span)]
    if separator:
        name = url2pathname(urlsplit(name).path)
    path = Path(name)
    if os.path.isdir(name):  # False for invalid names, which Path.is_dir refuses
        if drawings is not None and os.path.isdir(drawings) and os.path.samefile(name, drawings):
            raise InputError(
                f"--out {drawings}: holds the images to predict, and would hold drawings, too; "
                "name another folder"
            )
        if span != Span():
            warn(f"{name}: --start, --end, --every: for films alone; all of its images are used")
        return images_of(path, warn)
    return [file_source(path, span)]


def is_live(name: str) -> bool:
    """Whether a name is that of a camera or a stream; only its server knows this of an address of
    HTTP."""
    scheme, separator, _ = name.partition("://")
    return _is_camera(name) or bool(separator and scheme.lower() not in ("file", "http", "https"))


def _is_camera(name: str) -> bool:
    """Whether a name is a camera's number; longer ones, such as times, name folders and files."""
    return name.isascii() and name.isdecimal() and len(name) <= _MOST_DIGITS


class FramesOf(Protocol[F_co]):
    """The part of a `Source` that the loop needs, for frames of any type."""

    def frames(self, warn: Warn) -> Iterator[F_co]:
        """The frames in order. Raises InputError naming the source if it cannot be read."""


def for_each_frame(
    sources: Iterable[FramesOf[F]],
    work: Callable[[F], None],
    report: Callable[[str], None],
    warn: Warn,
) -> int:
    """Do the work for all frames of all sources. Returns the number of sources that failed.

    A source fails if it cannot be read or the work raises an InputError for one of its frames. It
    is reported, and the next source follows. An UnwritableError of the work ends the run.
    """
    failed = 0
    for source in sources:
        try:
            for frame in source.frames(warn):
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


@contextmanager
def outputs(
    folder: Path | None,
    style: Format,
    drawings: AbstractContextManager[AnnotatedFiles] | None,
    recording: AbstractContextManager[Write] | None,
    resumed: bool,
) -> Iterator[Write]:
    """Open all outputs. The yielded function writes a frame's shafts to a file in `folder`, or to
    standard output if that is None, draws them if there are `drawings`, and adds them to the
    recording, if any. resumed: whether earlier results are continued.

    Raises UnwritableError naming a file that cannot be written; for a recording, only at the end.
    """
    with ExitStack() as stack:
        parts: list[Write] = [stack.enter_context(result_stream(folder, style, resumed)).add]
        if drawings is not None:
            files = stack.enter_context(drawings)
            parts = [files.end_before, *parts, files.add]
        if recording is not None:
            parts.append(stack.enter_context(recording))

        def write(frame: Frame, shafts: Sequence[FoundShaft]) -> None:
            for add in parts:
                add(frame, shafts)

        yield write
