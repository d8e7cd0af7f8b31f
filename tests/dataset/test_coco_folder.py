"""Folders of images without poses: rendered sets as a stand-in."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_json
from shaftpose.core.samples import sample_key
from shaftpose.core.shard_writer import shard_name
from shaftpose.dataset.coco import read_coco
from shaftpose.dataset.coco_folder import copy_folder, read_folder, summary, write_stand_in
from tests.core.small_shards import make_sample, write_shard
from tests.dataset.coco_files import coco_content, write_dataset


def test_a_stand_in_has_masks_in_its_test_images_alone(tmp_path: Path) -> None:
    rendered, out = tmp_path / "rendered", tmp_path / "out"
    for name in ("train", "clear", "occluded"):
        sample = make_sample(0)
        scene = {**sample.scene_description, "occluders": name == "occluded"}
        write_shard(rendered / name / shard_name(0), [replace(sample, scene_description=scene)])
    write_stand_in(rendered, out)
    (train,), test = read_coco(out / "train.json"), read_coco(out / "test.json")
    names = [image.path.name for image in (train, *test)]
    assert names == [f"{name}-{sample_key(0)}.jpg" for name in ("train", "clear", "occluded")]
    assert all(image.path.is_file() for image in (train, *test))
    assert [instrument.mask for instrument in train.instruments] == [None, None]
    for image, occluded in zip(test, (False, True), strict=True):
        assert all(instrument.mask is not None for instrument in image.instruments)
        assert {instrument.occluded for instrument in image.instruments} == {occluded}


def test_a_summary_counts_what_is_annotated(tmp_path: Path) -> None:
    content = coco_content()
    content["categories"] = [{"id": 7, "name": "tool"}]
    tool = {"image_id": 4, "category_id": 7, "bbox": [10, 5, 20, 30]}
    tool["segmentation"] = content["annotations"][0]["segmentation"]
    content["annotations"].append(tool)
    images = read_coco(write_dataset(tmp_path, content))
    assert summary(images) == "2 images with 2 shafts (1 outlined), 1 tools"


def three_parts(folder: Path) -> Path:
    """Each part lists one image; that of `validation` shows a shaft without a mask."""
    for part in ("train", "validation", "test"):
        content = coco_content()
        entry = content["images"].pop(1) | {"file_name": f"images/{part}.jpg"}
        image = write_dataset(folder, coco_content()).parent / "images/a.jpg"
        shutil.copyfile(image, folder / entry["file_name"])
        shaft = {"image_id": entry["id"], "bbox": [10, 5, 20, 30]}
        annotations = [shaft] if part == "validation" else []
        write_json(folder / f"{part}.json", {"images": [entry], "annotations": annotations})
    return folder


def test_a_part_that_is_measured_needs_masks(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"validation\.json: the shaft of validation\.jpg"):
        copy_folder(three_parts(tmp_path / "source"), tmp_path / "out")


def test_a_validation_part_is_copied_where_there_is_one(tmp_path: Path) -> None:
    source, out = three_parts(tmp_path / "source"), tmp_path / "out"
    shutil.copyfile(source / "test.json", source / "validation.json")
    with pytest.raises(InputError, match=r"is in validation\.json and in test\.json"):
        copy_folder(source, out)
    (source / "validation.json").unlink()
    copy_folder(source, out)
    assert list(read_folder(out)) == ["train", "test"]
    content = json.loads((source / "test.json").read_text())
    content["images"][0]["file_name"] = "images/validation.jpg"
    write_json(source / "validation.json", content)
    copy_folder(source, out)
    names = {part: [i.path.name for i in images] for part, images in read_folder(out).items()}
    assert names == {part: [f"{part}.jpg"] for part in ("train", "validation", "test")}
