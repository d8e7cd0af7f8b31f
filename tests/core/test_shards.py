"""The on-disk format: run lengths, samples and damage."""

import json
import os
import socket
import subprocess
import sys
import tarfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.masks import mask_box
from shaftpose.core.shards import (
    Instrument,
    Sample,
    ShardedDataset,
    ShardWriter,
    decode_mask,
    encode_mask,
    holds,
    is_whole,
    sample_key,
    shard_name,
    shard_paths,
)
from shaftpose.errors import InputError

SIZE = 64
CAMERA = Camera.from_field_of_view(SIZE, SIZE, 95.0)


def rectangle(x0: int, y0: int, x1: int, y1: int) -> np.ndarray:
    mask = np.zeros((SIZE, SIZE), dtype=bool)
    mask[y0:y1, x0:x1] = True
    return mask


def instrument(pose: ShaftPose, mask: np.ndarray) -> Instrument:
    """A partly hidden instrument: its amodal mask is 4 px wider on the right."""
    x0, y0, x1, y1 = mask_box(mask)
    return Instrument(pose, mask, rectangle(x0, y0, x1 + 4, y1))


def make_sample(index: int, shafts: int = 2) -> Sample:
    """An image of coarse noise, which JPEG preserves, with `shafts` rectangles."""
    rng = np.random.default_rng(index)
    cells = rng.integers(0, 256, (SIZE // 16, SIZE // 16, 3), dtype=np.uint8)
    poses = [ShaftPose(1.5, -2.25, 20.0, 70.0, 123.0), ShaftPose(-4.0, 3.0, 31.0, 55.0, 1.0)]
    masks = [rectangle(3, 5, 20, 9), rectangle(30, 10, 41, 60)]
    instruments = [instrument(pose, mask) for pose, mask in zip(poses, masks, strict=True)]
    return Sample(
        key=sample_key(index),
        rgb=cells.repeat(16, axis=0).repeat(16, axis=1),
        instruments=tuple(instruments[:shafts]),
        camera=CAMERA,
        facts={"background": "b7", "light": 3.5, "seeds": [1, index]},
    )


def write_shard(path: Path, samples: list[Sample], quality: int = 95) -> None:
    with ShardWriter(path, quality) as writer:
        for sample in samples:
            writer.write(sample)


def overwrite(path: Path, offset: int, data: bytes) -> None:
    content = bytearray(path.read_bytes())
    content[offset : offset + len(data)] = data
    path.write_bytes(content)


def member(path: Path, name: str) -> tarfile.TarInfo:
    with tarfile.open(path) as tar:
        return tar.getmember(name)


def read_member(path: Path, name: str) -> bytes:
    with tarfile.open(path) as tar:
        file = tar.extractfile(name)
        assert file is not None
        return file.read()


def test_names() -> None:
    assert sample_key(42) == "000000042"
    assert shard_name(3) == "shard-000003.tar"


def test_run_lengths_by_hand() -> None:
    # Column by column: (0, 1), (1, 1), (0, 0) are 0 1 1 1 0 0: one zero, three ones, two zeros.
    mask = np.array([[0, 1, 0], [1, 1, 0]], dtype=bool)
    assert encode_mask(mask) == {"counts": [1, 3, 2], "size": [2, 3]}
    # Counts start with the zeros: 0 if the first pixel is set.
    assert encode_mask(~mask) == {"counts": [0, 1, 3, 2], "size": [2, 3]}
    assert encode_mask(np.zeros((2, 3), dtype=bool))["counts"] == [6]
    assert encode_mask(np.ones((2, 3), dtype=bool))["counts"] == [0, 6]


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 1.0])
def test_run_lengths_round_trip_and_mean_what_coco_says(share: float) -> None:
    rng = np.random.default_rng(3)
    for height, width in [(1, 1), (1, 9), (7, 1), (13, 17)]:
        mask = rng.random((height, width)) < share
        encoded = json.loads(json.dumps(encode_mask(mask)))
        np.testing.assert_array_equal(decode_mask(encoded), mask)
        # COCO: runs of zeros and ones in turn; pixel n is row n mod height of column n / height.
        picture = np.zeros((height, width), dtype=bool)
        n = 0
        for turn, run in enumerate(encoded["counts"]):
            for _ in range(run):
                picture[n % height, n // height] = turn % 2 == 1
                n += 1
        assert n == height * width
        np.testing.assert_array_equal(picture, mask)


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
        facts = dataset.facts(sample.key)
        assert {name: facts[name] for name in sample.facts} == sample.facts
        rgb = dataset.rgb(sample.key)
        assert rgb.dtype == np.uint8
        # JPEG blurs the colours at the borders of the cells: compare their centres.
        assert rgb.shape == sample.rgb.shape
        difference = rgb[8::16, 8::16].astype(int) - sample.rgb[8::16, 8::16]
        assert np.abs(difference).max() <= 4


def test_hand_values_of_a_read_sample(tmp_path: Path) -> None:
    write_shard(tmp_path / shard_name(0), [make_sample(0)])
    read = ShardedDataset(tmp_path).annotations("000000000")
    np.testing.assert_array_equal(read.boxes, [[3, 5, 20, 9], [30, 10, 41, 60]])
    np.testing.assert_array_equal(read.poses, [[1.5, -2.25, 20, 70, 123], [-4, 3, 31, 55, 1]])


def test_content_is_what_bop_asks_for(tmp_path: Path) -> None:
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(0)])
    with tarfile.open(path) as tar:
        assert set(tar.getnames()) == {
            f"000000000.{suffix}"
            for suffix in ("rgb.jpg", "camera.json", "gt.json", "gt_info.json", "mask.json",
                           "mask_visib.json", "shaft.json")
        }  # fmt: skip
    parts = {name: json.loads(read_member(path, f"000000000.{name}.json"))
             for name in ("camera", "gt", "gt_info", "mask", "shaft")}  # fmt: skip
    # f = 64 / (2 tan 47.5 deg) = 29.322.
    expected = [29.322, 0, 32, 0, 29.322, 32, 0, 0, 1]
    np.testing.assert_allclose(parts["camera"]["cam_K"], expected, atol=1e-3)
    first = parts["gt"][0]
    assert first["obj_id"] == 1
    assert first["cam_t_m2c"] == [1.5, -2.25, 20.0]
    # Row by row, as in BOP; pitch 70, yaw 123: (sin p cos w, sin p sin w, -cos p).
    rotation = np.array(first["cam_R_m2c"]).reshape(3, 3)
    np.testing.assert_allclose(rotation[:, 2], [-0.511793, 0.788092, -0.342020], atol=1e-6)
    info = parts["gt_info"][0]
    # 3, 5, 20, 9 is 17 wide and 4 high; the amodal box is 4 wider; 17 * 4 = 68 px.
    assert info["bbox_visib"] == [3, 5, 17, 4]
    assert info["bbox_obj"] == [3, 5, 21, 4]
    assert (info["px_count_visib"], info["px_count_all"]) == (68, 84)
    assert info["visib_fract"] == 68 / 84
    # 3 columns of 64 px and 5 px before the first run of 4; after 20 more columns the rest.
    counts = parts["mask"]["0"]["counts"]
    assert (counts[:4], len(counts)) == ([197, 4, 60, 4], 2 * 21 + 1)
    assert parts["shaft"]["shafts"][1] == {
        "x_mm": -4.0, "y_mm": 3.0, "z_mm": 31.0, "pitch_deg": 55.0, "yaw_deg": 1.0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("lens", "stated"),
    [
        ({}, {}),
        ({"k1": -0.2, "k2": 0.05}, {"distortion": [-0.2, 0.05]}),
        ({"field_px": 60.0}, {"field_px": 60.0}),
        ({"k2": 0.1, "field_px": 60.0}, {"distortion": [0.0, 0.1], "field_px": 60.0}),
    ],
)
def test_a_camera_states_its_lens_and_survives(
    tmp_path: Path, lens: dict[str, float], stated: dict[str, object]
) -> None:
    camera = replace(CAMERA, **lens)
    path = tmp_path / shard_name(0)
    write_shard(path, [replace(make_sample(0), camera=camera)])
    about = json.loads(read_member(path, f"{sample_key(0)}.camera.json"))
    assert about == {"cam_K": CAMERA.matrix.ravel().tolist(), "depth_scale": 1.0} | stated
    assert ShardedDataset(tmp_path).camera(sample_key(0)) == camera


def test_a_roll_is_part_of_the_rotation_alone(tmp_path: Path) -> None:
    sample = make_sample(0, shafts=1)
    rolled = replace(sample.instruments[0], roll_deg=90.0)
    path = tmp_path / shard_name(0)
    write_shard(path, [replace(sample, instruments=(rolled,))])
    (pose,) = json.loads(read_member(path, f"{sample_key(0)}.gt.json"))
    rotation = np.reshape(pose["cam_R_m2c"], (3, 3))
    np.testing.assert_allclose(rotation, rolled.pose.rolled(90.0))
    assert not np.allclose(rotation, rolled.pose.rotation)
    found = ShardedDataset(tmp_path).annotations(sample_key(0)).poses
    np.testing.assert_allclose(found, [rolled.pose.as_array()])


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
    ("name", "old", "new"),
    [
        ("gt_info.json", b"[3, 5, 17, 4]", b"[3, 5, 17   ]"),
        ("gt_info.json", b"bbox_visib", b"bbox_visit"),
        ("shaft.json", b"yaw_deg", b"yow_deg"),
    ],
)
def test_annotations_that_are_json_and_yet_wrong_are_named(
    tmp_path: Path, name: str, old: bytes, new: bytes
) -> None:
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(0)])
    found = read_member(path, f"000000000.{name}").find(old)
    assert found >= 0
    overwrite(path, member(path, f"000000000.{name}").offset_data + found, new)
    with pytest.raises(InputError, match="annotation of 000000000 is damaged") as caught:
        ShardedDataset(tmp_path).annotations("000000000")
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("name", "old", "new", "read"),
    [
        ("mask_visib.json", b'"size"', b'"sizf"', ShardedDataset.masks),
        ("mask_visib.json", b'"0"', b'"1"', ShardedDataset.masks),
        ("gt_info.json", b"visib_fract", b"visib_frict", ShardedDataset.visible_fractions),
    ],
)
def test_masks_and_shares_that_are_json_and_yet_wrong_are_named(
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
