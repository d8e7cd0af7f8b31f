"""The sources that words of the command line name."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from shaftpose.inference.frames import Source
from shaftpose.inference.image_files import ImageFile, images_of, is_image
from shaftpose.inference.live_streams import LiveStream
from shaftpose.inference.video_files import VideoFile


def sources(names: Iterable[str], lines: Iterable[str]) -> Iterator[Source]:
    """The sources with these names, in their order; `-` stands for the names on `lines`.

    Lines are read only when their turn comes.
    """
    for name in names:
        if name == "-":
            for line in lines:
                if written := line.rstrip("\r\n"):
                    yield from _named(written)
        else:
            yield from _named(name)


def _named(name: str) -> Iterable[Source]:
    """A whole number is a camera, what has `://` a stream; the rest are paths."""
    if name.isdecimal():
        return [LiveStream(int(name))]
    if "://" in name:
        return [LiveStream(name)]
    path = Path(name)
    if os.path.isdir(name):  # unlike the method of a path, False for what is no valid name
        return images_of(path)
    return [ImageFile(path) if is_image(path) else VideoFile(path)]
