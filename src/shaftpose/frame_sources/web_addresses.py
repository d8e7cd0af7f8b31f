"""Files and streams on the web as sources of frames."""

import logging
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from http.client import HTTPException, HTTPResponse
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import urlopen

from shaftpose.core.errors import InputError, Warn
from shaftpose.frame_sources.frames import Frame, ImageFile, Source
from shaftpose.frame_sources.live_streams import LiveStream
from shaftpose.frame_sources.video_files import Span, VideoFile
from shaftpose.image_files.reading import is_image

_PATIENCE_S = 30.0
# Playlists name other files, perhaps without end; pictures in parts come from cameras.
_LIVE = ("mpegurl", "dash+xml", "multipart/")
_MISSING = (404, 410)  # of HTTP
_log = logging.getLogger(__name__)


def file_source(path: Path, span: Span, first: int = 0) -> Source:
    """An image file or a video file."""
    return ImageFile(path) if is_image(path) else VideoFile(path, span, first)


@dataclass(frozen=True)
class WebAddress:
    """A URL of HTTP: a `Source` of all frames of a file, which is downloaded first, or of a live
    stream's newest ones."""

    name: str
    span: Span = Span()  # of a film
    first: int = 0
    length: None = None

    def frames(self, warn: Warn = _log.warning) -> Iterator[Frame]:
        """The frames in order. Raises InputError naming the address if it cannot be read whole."""
        with _opened(self.name) as response, TemporaryDirectory() as folder:
            if response is None:
                source: Source = LiveStream(self.name)
            else:
                path = Path(folder) / f"file{Path(urlsplit(self.name).path).suffix}"
                self._download(response, path)
                source = file_source(path, self.span, self.first)
                if self.first and isinstance(source, ImageFile):
                    return
            try:
                # Warnings would name the file, which is removed.
                for frame in source.frames(lambda text: warn(text.replace(source.name, self.name))):
                    yield replace(frame, source=self.name)
            except InputError as error:
                raise InputError(str(error).replace(source.name, self.name)) from error

    def _download(self, response: HTTPResponse, path: Path) -> None:
        size = int(response.headers["Content-Length"])
        try:
            with path.open("wb") as file:
                shutil.copyfileobj(response, file)
        except (OSError, HTTPException) as error:
            raise InputError(
                f"{self.name}: cannot be downloaded to {path.parent} ({error})"
            ) from error
        if path.stat().st_size < size:
            raise InputError(
                f"{self.name}: the connection broke after {path.stat().st_size:,} of {size:,} bytes"
            )


@contextmanager
def _opened(address: str) -> Iterator[HTTPResponse | None]:
    """The answer of a server that sends a file of a stated size; None for live streams, and where
    only OpenCV may know what to do. Raises InputError if the server has nothing at this address."""
    try:
        response = urlopen(address, timeout=_PATIENCE_S)
    except (OSError, ValueError, HTTPException) as error:
        if isinstance(error, HTTPError) and error.code in _MISSING:
            raise InputError(
                f"{address}: the server answers {error.code}: {error.reason}"
            ) from error
        yield None
        return
    with response:
        kind = response.headers.get("Content-Type", "").lower()
        ends = response.headers.get("Content-Length", "").isdecimal()
        yield response if ends and not any(word in kind for word in _LIVE) else None
