"""Atomic file writes, CSV files, and full disks."""

from pathlib import Path

import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.files import naming_full_disk, new_file, read_json, write_csv


def write(path: Path, text: str) -> None:
    with new_file(path) as part:
        part.write_text(text)


def test_a_file_and_its_folder_are_made(tmp_path: Path) -> None:
    write(tmp_path / "a/b.txt", "new")
    assert (tmp_path / "a/b.txt").read_text() == "new"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b.txt"]


def test_a_link_that_may_not_be_written_to_keeps_what_it_has(tmp_path: Path) -> None:
    """Like a file in DVC's cache: read-only, with a second hard link."""
    cached, output = tmp_path / "cached", tmp_path / "output"
    cached.write_text("old")
    output.hardlink_to(cached)
    cached.chmod(0o444)
    write(output, "new")
    assert (cached.read_text(), output.read_text()) == ("old", "new")


def test_what_is_cut_off_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write(path, "old")
    with pytest.raises(KeyboardInterrupt), new_file(path) as part:
        part.write_text("ne")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_parts_that_others_have_made_are_left_alone(tmp_path: Path) -> None:
    """The user's own files, or what a killed process has left; one is a link to nowhere."""
    path, own, link = tmp_path / "file", tmp_path / "file.part", tmp_path / "file.2.part"
    own.write_text("mine")
    link.symlink_to(tmp_path / "nowhere")
    with new_file(path) as first, new_file(path) as second:
        first.write_text("one")
        second.write_text("two")
    assert path.read_text() == "one"
    assert own.read_text() == "mine"
    assert sorted(tmp_path.iterdir()) == sorted([path, own, link])


def test_a_full_disk_is_named_with_the_remedy(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match="No space left on device; make room") as caught,
        naming_full_disk(tmp_path),
        open("/dev/full", "w") as full,
    ):
        full.write("to a disk without room")
    assert str(caught.value).startswith(f"{tmp_path}: ")


def test_other_errors_of_a_disk_stay_what_they_are(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), naming_full_disk(tmp_path):
        (tmp_path / "missing").read_text()


def test_a_table_has_its_headings_first(tmp_path: Path) -> None:
    write_csv(tmp_path / "a/table.csv", ["name", "value"], [["x, y", 0.5], ["z", 2]])
    assert (tmp_path / "a/table.csv").read_bytes() == b'name,value\n"x, y",0.5\nz,2\n'


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("none.json", "missing"),
        ("", "cannot be read .Is a directory"),
        ("a.csv/b", "cannot be read .Not a directory"),
        ("a.csv", "cannot be read as JSON"),
    ],
)
def test_what_is_no_json_file_is_named(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / "a.csv").write_text("step")
    with pytest.raises(InputError, match=f"^{tmp_path / name}: {says}.*; run it again$"):
        read_json(tmp_path / name, "run it again")
