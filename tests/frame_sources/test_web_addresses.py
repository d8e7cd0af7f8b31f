"""Files and streams of a local web server."""

from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.images import encode_jpeg
from shaftpose.frame_sources.frames import Frame
from shaftpose.frame_sources.web_addresses import WebAddress
from tests.frame_sources.videos import write_video


class Answers(BaseHTTPRequestHandler):
    """A film, a photo, half of a film, and a camera that sends three pictures."""

    film = b""
    photo = encode_jpeg(np.full((48, 64, 3), 90, dtype=np.uint8), 95)

    def do_GET(self) -> None:  # noqa: N802
        getattr(self, Path(self.path).stem, self.missing)()

    def whole(self) -> None:
        self.send(self.film)

    def picture(self) -> None:
        self.send(self.photo)

    def broken(self) -> None:
        self.send(self.film, len(self.film) // 2)

    def camera(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
        self.end_headers()
        for _ in range(3):
            head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(self.photo)}"
            self.wfile.write(f"{head}\r\n\r\n".encode() + self.photo + b"\r\n")
        self.wfile.write(b"--next--\r\n")

    def missing(self) -> None:
        self.send_error(404)

    def send(self, data: bytes, end: int | None = None) -> None:
        self.send_response(200)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data[:end])

    def log_message(self, *words: object) -> None:
        pass


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    film = write_video(tmp_path / "clip.avi", range(40, 240, 4)).read_bytes()
    monkeypatch.setattr(Answers, "film", film)
    with ThreadingHTTPServer(("127.0.0.1", 0), Answers) as running:
        Thread(target=running.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{running.server_port}"
        running.shutdown()


def read(address: str) -> list[Frame]:
    return list(WebAddress(address).frames(pytest.fail))


def test_a_file_is_read_whole(server: str) -> None:
    frames = read(f"{server}/whole.avi")
    assert [frame.number for frame in frames] == list(range(50))
    assert {frame.source for frame in frames} == {f"{server}/whole.avi"}
    assert frames[49].time_s == pytest.approx(4.9)


def test_an_image_is_an_image(server: str) -> None:
    (frame,) = read(f"{server}/picture.jpg")
    assert (frame.time_s, frame.rgb.shape) == (None, (48, 64, 3))


def test_a_warning_names_the_address(server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    oblong = encode_jpeg(np.full((48, 64, 3), 90, dtype=np.uint8), 95)
    density = oblong.index(b"JFIF") + 8  # across and along, 1 : 1
    monkeypatch.setattr(Answers, "photo", oblong[:density] + b"\0\2\0\1" + oblong[density + 4 :])
    warnings: list[str] = []
    list(WebAddress(f"{server}/picture.jpg").frames(warnings.append))
    (warning,) = warnings
    assert warning.startswith(f"{server}/picture.jpg: ")


def test_a_connection_that_breaks_is_reported(server: str) -> None:
    with pytest.raises(InputError, match=f"^{server}/broken.avi: the connection broke after "):
        read(f"{server}/broken.avi")


def test_a_camera_on_the_web_is_live(server: str) -> None:
    frames: list[Frame] = []
    with pytest.raises(InputError, match=f"^{server}/camera.mjpg: shows no more frames"):
        frames.extend(WebAddress(f"{server}/camera.mjpg").frames(pytest.fail))
    assert frames and frames[0].rgb.shape == (48, 64, 3)


def test_what_is_not_there_is_named(server: str) -> None:
    address = f"{server}/nothing.mp4"
    with pytest.raises(InputError, match=f"^{address}: the server answers 404: Not Found$"):
        read(address)
