"""Indexes of shards, whole and truncated."""

from pathlib import Path

import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.samples import sample_key
from shaftpose.core.shard_index import holds, is_whole, shard_paths
from shaftpose.core.shard_writer import shard_name
from shaftpose.core.shards import ShardedDataset
from tests.core.small_shards import make_sample, member, overwrite, write_shard


@pytest.mark.parametrize("cut", [0, 1, 511, 512, 513, 1024, 5000, 10240, 20480, -10240, -512, -1])
def test_a_truncated_shard_is_named(tmp_path: Path, cut: int) -> None:
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(n) for n in range(4)])
    data = path.read_bytes()
    assert len(data) > 20480
    path.write_bytes(data[:cut])
    with pytest.raises(InputError, match="truncated or damaged") as caught:
        ShardedDataset(tmp_path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "run `dvc repro -s -f render`" in str(caught.value)
    assert not is_whole(path)


def test_a_shard_cut_at_any_block_is_refused(tmp_path: Path) -> None:
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(0)])
    data = path.read_bytes()
    for cut in range(0, len(data), 512):
        path.write_bytes(data[:cut])
        with pytest.raises(InputError, match="truncated or damaged"):
            ShardedDataset(tmp_path)


@pytest.mark.parametrize("header", [b"x" * 512, bytes(512)])
def test_a_damaged_header_is_not_passed_over(tmp_path: Path, header: bytes) -> None:
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(0), make_sample(1)])
    overwrite(path, member(path, "000000001.rgb.jpg").offset, header)
    with pytest.raises(InputError, match="truncated or damaged"):
        ShardedDataset(tmp_path)


def test_a_shard_holds_its_samples_and_no_others(tmp_path: Path) -> None:
    path, keys = tmp_path / shard_name(0), [sample_key(0), sample_key(1)]
    write_shard(path, [make_sample(0), make_sample(1)])
    assert holds(path, keys)
    assert not holds(path, keys[:1])
    assert not holds(path, [*keys, sample_key(2)])


@pytest.mark.parametrize("name", ["000000000.rgb.jpg", "000000001.rgb.jpg", "000000001.shaft.json"])
def test_a_shard_of_zeros_from_some_member_on_holds_too_little(tmp_path: Path, name: str) -> None:
    """Zeros left by a power loss look like the end of an archive."""
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(0), make_sample(1)])
    start = member(path, name).offset
    overwrite(path, start, bytes(path.stat().st_size - start))
    assert is_whole(path)
    assert not holds(path, [sample_key(0), sample_key(1)])


def test_a_shard_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / shard_name(0)
    path.mkdir()
    opened = (
        lambda: ShardedDataset(tmp_path),
        lambda: is_whole(path),
        lambda: holds(path, [sample_key(0)]),
    )
    for read in opened:
        with pytest.raises(
            InputError, match=rf"^{path}: cannot be read \(Is a directory\); delete"
        ):
            read()


def test_a_folder_without_shards_is_named(tmp_path: Path) -> None:
    (tmp_path / "shard-000000.tar.part").write_bytes(b"unfinished")
    for folder in (tmp_path, tmp_path / "missing"):
        with pytest.raises(InputError, match="no shard") as caught:
            ShardedDataset(folder)
        assert str(caught.value).startswith(f"{folder}: ")


def test_shards_are_found_in_order(tmp_path: Path) -> None:
    for index in (10, 2):
        write_shard(tmp_path / shard_name(index), [make_sample(index)])
    assert [path.name for path in shard_paths(tmp_path)] == [shard_name(2), shard_name(10)]
