"""A user's mistake ends in one line that names it, and status 1."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from shaftpose.backgrounds.library import write_library
from shaftpose.backgrounds.variations import VariationRanges
from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import write_jpeg
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter, shard_name
from shaftpose.dataset.coco_folder import copy_folder
from tests.pipeline.conftest import Run, replace_in


def complaint(run: Run, *command: str) -> str:
    """The last line of a command that must fail without a traceback."""
    return last_line(run("python", *command))


def last_line(result: subprocess.CompletedProcess[str]) -> str:
    """The last line of a result that must have failed without a traceback."""
    assert result.returncode == 1, result.stdout
    assert "Traceback" not in result.stderr
    line = result.stderr.strip().splitlines()[-1]
    assert line.startswith("error: ")
    return line


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("profile=huge", "profile = 'huge'"),
        ("profiles.smoke.images=-3", "images = -3"),
        ("poses.x_mm=[20,-20]", "poses.x_mm"),
        ("poses.z_mm=deep", "poses.z_mm = 'deep'"),
        ("scene.instruments=[2,1]", "scene.instruments"),
        ("seed=-1", "seed = -1"),
        ("real.stand_in.lens.haze=[0,2]", "params.yaml: real.stand_in.lens.haze"),
    ],
)
def test_render_settings(run: Run, tmp_path: Path, override: str, named: str) -> None:
    line = complaint(run, "pipelines/backgrounds.py", f"out={tmp_path}", override)
    assert named in line


# All stages read all settings alike; split imports no torch and starts fastest.
def test_a_missing_size_is_named(run: Run, tmp_path: Path) -> None:
    line = complaint(run, "pipelines/split.py", f"out={tmp_path}", "~profiles.smoke.depth")
    assert line == "error: conf/profiles.yaml: smoke.depth is missing; add it"


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("view_deg: 95.0", "view_deg: 95.0: 3", "error: params.yaml: no YAML: mapping values"),
        ("preset: none", "", "error: params.yaml: lacks `preset`; set it to none"),
    ],
)
def test_what_is_wrong_with_the_settings_as_a_whole_is_named(
    run: Run, clone: Path, tmp_path: Path, old: str, new: str, named: str
) -> None:
    params = clone / "params.yaml"
    whole = params.read_text()
    replace_in(params, old, new)
    try:
        line = complaint(run, "pipelines/split.py", f"out={tmp_path}")
    finally:
        params.write_text(whole)
    assert line.startswith(named)


def test_beta_of_the_wrong_length(run: Run, tmp_path: Path) -> None:
    line = complaint(run, "pipelines/split.py", f"out={tmp_path}", "loss.beta=[1,1,2]")
    assert "loss.beta" in line


def test_unknown_variant_is_named_with_the_known_ones(run: Run, tmp_path: Path) -> None:
    result = run("python", "pipelines/split.py", "variant=z", f"out={tmp_path}")
    assert result.returncode == 1
    assert "variant/z" in result.stderr
    assert "d_noise_real" in result.stderr


def test_an_unknown_variant_in_the_list_does_not_wait_for_its_training(
    run: Run, tmp_path: Path
) -> None:
    line = complaint(run, "pipelines/backgrounds.py", f"out={tmp_path}", "variants=[d,z]")
    assert line.startswith("error: params.yaml: variants: 'z': unknown; choose from b, c, d, ")


def test_empty_background_folder(run: Run, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    line = complaint(
        run,
        "pipelines/backgrounds.py",
        f"out={tmp_path / 'out'}",
        f"backgrounds.source={tmp_path / 'empty'}",
    )
    assert str(tmp_path / "empty") in line


def test_a_wrong_loss_weight_does_not_wait_for_the_render(run: Run, tmp_path: Path) -> None:
    line = complaint(run, "pipelines/backgrounds.py", f"out={tmp_path}", "loss.alpha=-1")
    assert line.startswith("error: params.yaml: loss.alpha = -1")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A working directory of stages, with the files that a test puts there."""
    return tmp_path


@pytest.fixture
def stage(run: Run, clone: Path, folder: Path) -> Run:
    """Runs a script of the clone's pipeline in `folder`, to write to `folder/written`."""

    def run_stage(script: str, *overrides: str) -> subprocess.CompletedProcess[str]:
        command = ("python", str(clone / "pipelines" / script), f"out={folder / 'written'}")
        return run("env", f"--chdir={folder}", *command, *overrides)

    return run_stage


def write_shard(folder: Path, images: int) -> Path:
    """A shard of small images with one shaft each."""
    mask = np.zeros((64, 64), dtype=bool)
    mask[20:30, 10:50] = True
    pose = ShaftPose(0.0, 0.0, 20.0, 70.0, 120.0)
    shaft = Instrument(pose, mask, mask)
    camera = Camera.from_field_of_view(64, 64, 95.0)
    rgb = np.full((64, 64, 3), 90, dtype=np.uint8)
    path = folder / shard_name(0)
    with ShardWriter(path, 95) as writer:
        for n in range(images):
            writer.write(Sample(sample_key(n), rgb, (shaft,), camera, {"source": f"s{n}"}))
    return path


def write_backgrounds(folder: Path, count: int) -> None:
    """A library of grey squares, each from a source of its own."""
    unaltered = VariationRanges((0.0, 0.0), (1.0, 1.0), (1.0, 1.0))
    sources = ((f"s{n}", np.full((299, 299, 3), 10 * n, dtype=np.uint8)) for n in range(count))
    write_library(sources, folder, 1, unaltered, 0, 299, count)


def test_a_truncated_shard(stage: Run, folder: Path) -> None:
    write_backgrounds(folder / "data/backgrounds", 4)
    path = write_shard(folder / "data/render/images", 4)
    path.write_bytes(path.read_bytes()[:-15_000])
    result = stage("validate.py")
    line = last_line(result)
    # Two more shards of the smoke profile's 60 images are missing, and two of each test set.
    shard = path.relative_to(folder)
    expected = f"error: {shard}: 000000000 to 000000019: truncated or damaged (problem 1 of 7)"
    assert line.startswith(expected)
    assert "run `dvc repro -s -f render`" in line
    assert "data/render/occluded/shard-000001.tar: 000000001 to 000000001: missing" in result.stdout
    assert not (folder / "written").exists()


def test_a_split_of_what_was_not_validated(stage: Run) -> None:
    line = last_line(stage("split.py"))
    assert line == "error: data/validation/sources.json: missing; run `dvc repro validate`"


def test_a_checkpoint_of_another_variant(stage: Run, folder: Path) -> None:
    identity = {"variant": "c", "width": 0.1875, "depth": 0.25}
    torch.save({"identity": identity, "state_dict": {}}, folder / "model.ckpt")
    line = last_line(stage("export.py", "variant=d", f"model_folder={folder}"))
    assert str(folder / "model.ckpt") in line
    assert "'variant': 'c'" in line
    assert "'variant': 'd'" in line


def grey_image(path: Path) -> None:
    write_jpeg(np.full((40, 60, 3), 90, dtype=np.uint8), path)


def test_a_corrupt_background_is_passed_over(stage: Run, folder: Path) -> None:
    photos = folder / "photos"
    grey_image(photos / "a.jpg")
    grey_image(photos / "c.jpg")
    (photos / "b.jpg").write_bytes((photos / "a.jpg").read_bytes()[:200])
    result = stage("backgrounds.py", f"backgrounds.source={photos}")
    assert result.returncode == 0, result.stderr
    assert f"skipped {photos / 'b.jpg'}" in result.stdout
    index = (folder / "written" / "index.csv").read_text()
    assert "a.jpg" in index
    assert "b.jpg" not in index


def test_corrupt_backgrounds_alone(stage: Run, folder: Path) -> None:
    photos = folder / "photos"
    photos.mkdir()
    for name in ("a.jpg", "b.jpg"):
        (photos / name).write_bytes(b"not a picture")
    result = stage("backgrounds.py", f"backgrounds.source={photos}")
    assert f"none of the 2 images in {photos}" in last_line(result)


def write_real(folder: Path, boxes: dict[str, list[float]]) -> Path:
    """A folder of real images, 60 x 40 px with one shaft each; the first one is for training."""
    names = sorted(boxes)
    for name in names:
        grey_image(folder / "images" / name)
    for part, own in (("train", names[:1]), ("test", names[1:])):
        content = {
            "images": [
                {"id": n, "file_name": f"images/{name}", "width": 60, "height": 40}
                for n, name in enumerate(own)
            ],
            "annotations": [
                {"image_id": n, "bbox": boxes[name], "segmentation": [[5, 5, 20, 5, 20, 20]]}
                for n, name in enumerate(own)
            ],
        }
        (folder / f"{part}.json").write_text(json.dumps(content))
    return folder


GOOD_BOXES = {"a.jpg": [5, 5, 15, 15], "b.jpg": [5, 5, 55.4, 15]}  # 60.4 of 60: rounded


def test_a_real_box_outside_its_image(stage: Run, folder: Path) -> None:
    real = write_real(folder / "real", GOOD_BOXES | {"a.jpg": [50, 5, 15, 15]})
    line = last_line(stage("real_images.py", f"real.source={real}"))
    assert f"{real / 'train.json'}: annotations[0]: the box [50.0, 5.0, 15.0, 15.0]" in line
    assert "images/a.jpg" in line


def test_a_missing_real_image(stage: Run, folder: Path) -> None:
    real = write_real(folder / "real", GOOD_BOXES)
    (real / "images/b.jpg").unlink()
    line = last_line(stage("real_images.py", f"real.source={real}"))
    assert f"{real / 'test.json'}: images[0].file_name = 'images/b.jpg': no such file" in line


# Starting a stage takes seconds: the tests below call its function.


def test_good_real_images_replace_those_of_an_earlier_run(tmp_path: Path) -> None:
    real, out = write_real(tmp_path / "real", GOOD_BOXES), tmp_path / "out"
    (out / "images").mkdir(parents=True)
    (out / "images/a.jpg").write_bytes(b"an older image")
    (out / "validation.json").write_text("a part that this source lacks")
    copy_folder(real, out)
    assert not (out / "validation.json").exists()
    for name in ("images/a.jpg", "images/b.jpg", "train.json", "test.json"):
        assert (out / name).read_bytes() == (real / name).read_bytes()


def test_a_corrupt_real_image(tmp_path: Path) -> None:
    real = write_real(tmp_path / "real", GOOD_BOXES)
    (real / "images/a.jpg").write_bytes((real / "images/a.jpg").read_bytes()[:200])
    with pytest.raises(InputError, match=r"images/a\.jpg: not a readable image"):
        copy_folder(real, tmp_path / "out")


def test_a_real_image_in_both_parts(tmp_path: Path) -> None:
    real = write_real(tmp_path / "real", GOOD_BOXES)
    shutil.copy(real / "test.json", real / "train.json")
    with pytest.raises(InputError, match=r"b\.jpg is in train\.json and in test\.json"):
        copy_folder(real, tmp_path / "out")


def test_polygons_are_needed_in_tests_alone(tmp_path: Path) -> None:
    real = write_real(tmp_path / "real", GOOD_BOXES)
    for part in ("train", "test"):
        path = real / f"{part}.json"
        content = json.loads(path.read_text())
        content["annotations"][0]["segmentation"] = []
        path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"test\.json: the shaft of b\.jpg.*`segmentation`"):
        copy_folder(real, tmp_path / "out")
