"""Everything that a prediction writes: results, and drawings and a recording if asked."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

from shaftpose.inference.annotated_files import annotated_files
from shaftpose.inference.formats import Format
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.frames import Frame
from shaftpose.inference.result_stream import result_stream

Write = Callable[[Frame, Sequence[FoundShaft]], None]


@contextmanager
def outputs(
    folder: Path | None,
    style: Format,
    drawings: Path | None,
    recording: AbstractContextManager[Write] | None,
) -> Iterator[Write]:
    """A function that writes a frame's shafts into a folder, or to standard output if that is None,
    draws them into the folder `drawings`, if any, and adds them to the recording, if any.

    Raises UnwritableError naming a file that cannot be written, a recording only at the end.
    """
    with ExitStack() as stack:
        parts: list[Write] = [stack.enter_context(result_stream(folder, style)).add]
        if drawings is not None:
            parts.append(stack.enter_context(annotated_files(drawings)).add)
        if recording is not None:
            parts.append(stack.enter_context(recording))

        def write(frame: Frame, shafts: Sequence[FoundShaft]) -> None:
            for add in parts:
                add(frame, shafts)

        yield write
