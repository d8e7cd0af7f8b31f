"""Reading of shards, whole and damaged."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.masks import mask_box
from shaftpose.core.samples import sample_key
from shaftpose.core.shard_index import is_whole
from shaftpose.core.shard_writer import shard_name
from shaftpose.core.shards import ShardedDataset
from tests.core.small_shards import SIZE, make_sample, member, overwrite, read_member, write_shard


def test_a_sample_survives_writing_and_reading(tmp_path: Path) -> None:
    samples = [make_sample(11), make_sample(2), make_sample(5, shafts=0)]
    write_shard(tmp_path / shard_name(0), samples[:1])
    write_shard(tmp_path / shard_name(1), samples[1:])
    dataset = ShardedDataset(tmp_path)
    assert dataset.keys == ["000000002", "000000005", "000000011"]
    assert len(dataset) == 3
    for sample in samples:
        read = dataset.annotations(sample.key)
        assert read.poses is not None
        shafts = sample.instruments
        assert [tuple(box) for box in read.boxes] == [mask_box(s.mask) for s in shafts]
        assert [tuple(pose) for pose in read.poses] == [tuple(s.pose.as_array()) for s in shafts]
        assert read.boxes.shape == (len(sample.instruments), 4)
        masks = dataset.masks(sample.key)
        assert len(masks) == len(sample.instruments)
        for mask, written in zip(masks, sample.instruments, strict=True):
            np.testing.assert_array_equal(mask, written.mask)
        described = dataset.scene_description(sample.key)
        assert described == described | sample.scene_description
        rgb = dataset.rgb(sample.key)
        assert rgb.dtype == np.uint8
        # JPEG blurs the colours at the borders of the cells: compare their centres.
        assert rgb.shape == sample.rgb.shape
        difference = rgb[8::16, 8::16].astype(int) - sample.rgb[8::16, 8::16]
        assert np.abs(difference).max() <= 4


def test_a_tool_mask_survives_and_is_empty_by_default(tmp_path: Path) -> None:
    tool = np.zeros((SIZE, SIZE), dtype=bool)
    tool[7:9, 20:26] = True
    write_shard(tmp_path / shard_name(0), [replace(make_sample(0), tool_mask=tool), make_sample(1)])
    # 20 columns of 64 px and 7 px before the first run of 2, five more, and the rest.
    encoded = json.loads(read_member(tmp_path / shard_name(0), "000000000.mask_tool.json"))
    assert encoded == {"counts": [1287, *5 * [2, 62], 2, 2487], "size": [SIZE, SIZE]}
    dataset = ShardedDataset(tmp_path)
    np.testing.assert_array_equal(dataset.tool_mask("000000000"), tool)
    assert dataset.tool_mask("000000001").shape == (SIZE, SIZE)
    assert not dataset.tool_mask("000000001").any()


def test_hand_values_of_a_read_sample(tmp_path: Path) -> None:
    write_shard(tmp_path / shard_name(0), [make_sample(0)])
    read = ShardedDataset(tmp_path).annotations("000000000")
    np.testing.assert_array_equal(read.boxes, [[3, 5, 20, 9], [30, 10, 41, 60]])
    np.testing.assert_array_equal(read.poses, [[1.5, -2.25, 20, 70, 123], [-4, 3, 31, 55, 1]])


def test_a_damaged_image_is_named_with_its_key(tmp_path: Path) -> None:
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(0), make_sample(1)])
    overwrite(path, member(path, "000000001.rgb.jpg").offset_data, b"\0" * 64)
    dataset = ShardedDataset(tmp_path)
    assert dataset.rgb("000000000").shape == (SIZE, SIZE, 3)
    with pytest.raises(InputError, match="image 000000001 is damaged") as caught:
        dataset.rgb("000000001")
    assert str(caught.value).startswith(f"{path}: ")
    # A shard that counts as complete would be reused, so its copy in scratch must be deleted.
    assert is_whole(path)
    assert "delete shard-000000.tar in all folders of data/scratch" in str(caught.value)


def test_damaged_json_is_named_with_its_member(tmp_path: Path) -> None:
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(0)])
    overwrite(path, member(path, "000000000.shaft.json").offset_data, b"?")
    with pytest.raises(InputError, match="000000000.shaft.json is damaged"):
        ShardedDataset(tmp_path).annotations("000000000")


@pytest.mark.parametrize(
    ("name", "old", "new", "read"),
    [
        ("gt_info.json", b"[3, 5, 17, 4]", b"[3, 5, 17   ]", ShardedDataset.annotations),
        # A pose less than boxes.
        ("shaft.json", b'}, {"x_mm"', b'}],"":[{""', ShardedDataset.annotations),
        ("gt_info.json", b"bbox_visib", b"bbox_visit", ShardedDataset.annotations),
        ("shaft.json", b"yaw_deg", b"yow_deg", ShardedDataset.annotations),
        ("mask_visib.json", b'"size"', b'"sizf"', ShardedDataset.masks),
        ("mask_visib.json", b'"0"', b'"1"', ShardedDataset.masks),
        ("mask_tool.json", b'"size"', b'"sizf"', ShardedDataset.tool_mask),
        ("gt_info.json", b"visib_fract", b"visib_frict", ShardedDataset.visible_fractions),
    ],
)
def test_members_that_are_json_and_yet_wrong_are_named(
    tmp_path: Path, name: str, old: bytes, new: bytes, read: Callable[[ShardedDataset, str], object]
) -> None:
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(0)])
    found = read_member(path, f"000000000.{name}").find(old)
    assert found >= 0
    overwrite(path, member(path, f"000000000.{name}").offset_data + found, new)
    with pytest.raises(InputError, match="of 000000000 is damaged") as caught:
        read(ShardedDataset(tmp_path), "000000000")
    assert str(caught.value).startswith(f"{path}: ")


def test_a_camera_without_a_matrix_is_named(tmp_path: Path) -> None:
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(0)])
    found = read_member(path, "000000000.camera.json").find(b"cam_K")
    overwrite(path, member(path, "000000000.camera.json").offset_data + found, b"cam_Q")
    with pytest.raises(InputError, match="the camera of 000000000 is damaged"):
        ShardedDataset(tmp_path).camera("000000000")


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    write_shard(tmp_path / shard_name(0), [make_sample(0)])
    with pytest.raises(InputError, match="000000009.rgb.jpg is missing"):
        ShardedDataset(tmp_path).rgb("000000009")


def test_an_image_of_two_shards_is_named_with_both(tmp_path: Path) -> None:
    write_shard(tmp_path / shard_name(0), [make_sample(0), make_sample(1)])
    write_shard(tmp_path / shard_name(1), [make_sample(1)])
    with pytest.raises(InputError) as caught:
        ShardedDataset(tmp_path)
    first, second = (tmp_path / shard_name(n) for n in range(2))
    assert str(caught.value).startswith(f"{second}: image {sample_key(1)} is also in {first}; ")
