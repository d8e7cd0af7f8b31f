"""The members of a shard."""

import json
import tarfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.core.samples import sample_key
from shaftpose.core.shard_writer import shard_name
from shaftpose.core.shards import ShardedDataset
from tests.core.small_shards import CAMERA, make_sample, read_member, write_shard


def test_keys_sort_as_their_numbers() -> None:
    assert sample_key(42) == "000000042"


def test_content_is_what_bop_asks_for(tmp_path: Path) -> None:
    path = tmp_path / shard_name(0)
    write_shard(path, [make_sample(0)])
    with tarfile.open(path) as tar:
        assert set(tar.getnames()) == {
            f"000000000.{suffix}"
            for suffix in ("rgb.jpg", "camera.json", "gt.json", "gt_info.json", "mask.json",
                           "mask_visib.json", "mask_tool.json", "shaft.json")
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
        ({"field": CAMERA.disc(60.0)}, {"field_px": 60.0}),
        ({"k2": 0.1, "field": CAMERA.disc(60.0)}, {"distortion": [0.0, 0.1], "field_px": 60.0}),
    ],
)
def test_a_camera_states_its_lens_and_survives(
    tmp_path: Path, lens: dict[str, Any], stated: dict[str, object]
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
