"""Shards are whole under their names, whatever ends their writing."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from shaftpose.core.shard_index import is_whole
from shaftpose.core.shard_writer import ShardWriter, shard_name
from tests.core.small_shards import make_sample, write_shard


def test_shards_are_numbered() -> None:
    assert shard_name(3) == "shard-000003.tar"


def test_the_same_samples_are_the_same_bytes(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        write_shard(tmp_path / folder / "shard-000000.tar", [make_sample(0), make_sample(1)])
    one, two = (tmp_path / folder / "shard-000000.tar" for folder in ("a", "b"))
    assert one.read_bytes() == two.read_bytes()
    write_shard(two, [make_sample(0), make_sample(2)])
    assert one.read_bytes() != two.read_bytes()


def test_no_final_name_before_the_end(tmp_path: Path) -> None:
    path = tmp_path / shard_name(0)
    with ShardWriter(path, 95) as writer:
        writer.write(make_sample(0))
        assert not path.exists()
    assert [file.name for file in tmp_path.iterdir()] == ["shard-000000.tar"]
    assert is_whole(path)


def write_while_another_has_begun(path: Path, other_pid: int) -> Path:
    """Write a shard next to another process's temporary file and return that file's path."""
    with ShardWriter(path, 95):
        (own,) = path.parent.iterdir()
    other = own.with_name(own.name.replace(f".{os.getpid()}.", f".{other_pid}."))
    assert other != own
    other.write_bytes(b"half a shard")
    write_shard(path, [make_sample(0)])
    assert is_whole(path)
    return other


def test_the_temporary_file_of_another_process_is_left_alone(tmp_path: Path) -> None:
    part = write_while_another_has_begun(tmp_path / shard_name(0), os.getppid())
    assert part.read_bytes() == b"half a shard"


def test_what_a_dead_process_left_is_removed(tmp_path: Path) -> None:
    part = write_while_another_has_begun(tmp_path / shard_name(0), dead_pid())
    assert not part.exists()


@pytest.mark.parametrize("name", ["shard-000001.tar.{host}.{pid}", "shard-000000.tar.else.{pid}"])
def test_what_others_left_is_kept(tmp_path: Path, name: str) -> None:
    """Leftovers of another shard, and of another host, whose processes are not visible here."""
    name = name.format(host=socket.gethostname(), pid=dead_pid())
    (tmp_path / f"{name}.part").write_bytes(b"half a shard")
    write_shard(tmp_path / shard_name(0), [make_sample(0)])
    assert (tmp_path / f"{name}.part").exists()


def dead_pid() -> int:
    """The id of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_an_exception_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="lamp"), ShardWriter(
        tmp_path / shard_name(0), 95
    ) as writer:  # fmt: skip
        writer.write(make_sample(0))
        raise RuntimeError("the lamp is broken")
    assert list(tmp_path.iterdir()) == []
