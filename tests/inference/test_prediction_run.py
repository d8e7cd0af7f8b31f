"""All frames of all sources, whatever happens to some."""

from collections.abc import Iterator

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.inference.frames import Frame
from shaftpose.inference.prediction_run import for_each_frame
from shaftpose.inference.unwritable import UnwritableError

RGB = np.zeros((4, 4, 3), dtype=np.uint8)


class Clip:
    """Two frames, then perhaps an error."""

    length = 2

    def __init__(self, name: str, breaks: bool = False) -> None:
        self.name, self.breaks = name, breaks

    def frames(self) -> Iterator[Frame]:
        yield Frame(self.name, 0, RGB)
        yield Frame(self.name, 1, RGB)
        if self.breaks:
            raise InputError(f"{self.name}: ends early")


def test_a_source_that_breaks_does_not_stop_the_others() -> None:
    done: list[tuple[str, int]] = []
    reports: list[str] = []

    def work(frame: Frame) -> None:
        if frame.source == "b":
            raise InputError("of another size")
        done.append((frame.source, frame.number))

    clips = [Clip("a", breaks=True), Clip("b"), Clip("c")]
    assert for_each_frame(clips, work, reports.append) == 2
    assert done == [("a", 0), ("a", 1), ("c", 0), ("c", 1)]
    assert reports == ["a: ends early", "b: of another size"]


def test_results_that_cannot_be_kept_end_it() -> None:
    def work(frame: Frame) -> None:
        raise UnwritableError("disk: full")

    reports: list[str] = []
    with pytest.raises(UnwritableError, match="^disk: full$"):
        for_each_frame([Clip("a")], work, reports.append)
    assert reports == []
