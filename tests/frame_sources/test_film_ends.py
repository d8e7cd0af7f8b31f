"""The ends that video files state."""

from pathlib import Path

import pytest

from shaftpose.frame_sources.film_ends import counts_frames, film_seconds, is_cut, video_tracks
from tests.frame_sources.videos import box, write_matroska, write_video


@pytest.fixture(params=["mp4", "avi", "mkv"])
def film(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / f"clip.{request.param}"
    if request.param == "mkv":
        return write_matroska(path, [40, 80, 120], [0, 40, 80], 120)
    return write_video(path, [40, 80, 120])


def test_a_whole_film_is_told_from_a_cut_one(film: Path) -> None:
    assert not is_cut(film)
    data = film.read_bytes()
    for missing in (2, len(data) // 2):
        film.write_bytes(data[:-missing])
        assert is_cut(film)


def test_some_containers_count_their_frames(film: Path) -> None:
    assert counts_frames(film) == (film.suffix != ".mkv")
    assert film_seconds(film) == (pytest.approx(0.3) if film.suffix == ".mp4" else None)


def test_a_box_may_reach_to_the_end_or_state_64_bits(tmp_path: Path) -> None:
    path, head = tmp_path / "clip.mp4", box(b"ftyp", bytes(8))
    path.write_bytes(head + b"\0\0\0\0mdat" + bytes(99))
    assert not is_cut(path)
    for length in (100, 101, 2**64 - 1):
        path.write_bytes(head + b"\0\0\0\1mdat" + length.to_bytes(8, "big") + bytes(84))
        assert is_cut(path) == (length > 100)
        assert film_seconds(path) is None


@pytest.mark.parametrize(("sync", "length"), [(0, 188), (4, 192)])
def test_a_transport_stream_consists_of_whole_packets(
    sync: int, length: int, tmp_path: Path
) -> None:
    packet = bytes(sync) + b"G" + bytes(length - sync - 1)
    path = tmp_path / "clip.ts"
    path.write_bytes(3 * packet)
    assert not is_cut(path)
    path.write_bytes(3 * packet + packet[:100])
    assert is_cut(path)


@pytest.mark.parametrize("head", [b"", b"RIFF", b"\x1aE\xdf\xa3", b"\x1aE\xdf\xa3\x01" + bytes(20)])
def test_unknown_files_are_not_cut(head: bytes, tmp_path: Path) -> None:
    path = tmp_path / "clip"
    path.write_bytes(head)
    assert not is_cut(path)


@pytest.mark.parametrize("length", [0, 2**32 - 1])
def test_an_avi_that_was_written_to_a_pipe_states_no_end(length: int, tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    path.write_bytes(b"RIFF" + length.to_bytes(4, "little") + b"AVI " + bytes(50))
    assert not is_cut(path)


def test_a_wmv_film_states_its_size(tmp_path: Path) -> None:
    """[MS-ASF]: the header object, then the file properties with an id and the file's size."""
    path = tmp_path / "clip.wmv"
    header = bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c") + bytes(14)
    properties = bytes.fromhex("a1dcab8c47a9cf118ee400c00c205365") + bytes(8) + bytes(16)
    for stated, cut in ((200, False), (201, True)):
        data = header + properties + stated.to_bytes(8, "little")
        path.write_bytes(data.ljust(200, b"\0"))
        assert is_cut(path) == cut
    live = data.ljust(30 + 88, b"\0") + b"\1"  # of a live recording, the size means nothing
    path.write_bytes(live.ljust(200, b"\0"))
    assert not is_cut(path)


def test_an_avi_may_count_its_head(tmp_path: Path) -> None:
    path = write_video(tmp_path / "clip.avi", [40, 80])
    data = path.read_bytes()
    length = int.from_bytes(data[4:8], "little")
    path.write_bytes(data[:4] + (length + 8).to_bytes(4, "little") + data[8:])
    assert not is_cut(path)


def test_the_videos_in_a_film_are_counted(film: Path) -> None:
    assert video_tracks(film) == 1
    data = film.read_bytes()
    if film.suffix == ".mp4":
        track = data[data.index(b"trak") - 4 :]
        track = track[: int.from_bytes(track[:4], "big")]
        start = data.index(b"moov") - 4
        end = start + int.from_bytes(data[start : start + 4], "big")
        moov = box(b"moov", data[start + 8 : end] + track)
        film.write_bytes(data[:start] + moov + data[end:])
        assert video_tracks(film) == 2


def test_videos_of_matroska_are_counted_where_they_are_described(tmp_path: Path) -> None:
    """The index before the tracks names them, too."""

    def element(name: str, content: bytes) -> bytes:
        return bytes.fromhex(name) + (0x4000 + len(content)).to_bytes(2, "big") + content

    index = element("114d9b74", element("4dbb", element("53ab", bytes.fromhex("1654ae6b"))))
    tracks = element(
        "1654ae6b", 2 * element("ae", b"\x83\x81\x01") + element("ae", b"\x83\x81\x02")
    )
    content = index + element("ec", bytes(6000)) + tracks
    path = tmp_path / "clip.mkv"
    path.write_bytes(element("1a45dfa3", bytes(9)) + element("18538067", content))
    assert video_tracks(path) == 2
    path.write_bytes(path.read_bytes().replace(bytes.fromhex("ec5770"), bytes.fromhex("ec0070")))
    assert video_tracks(path) == 1  # a damaged length: no more is known
