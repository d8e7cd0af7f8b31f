"""COCO files of CVAT and Label Studio: minimal exports, written by hand."""

import json
import logging
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.images import write_jpeg
from shaftpose.dataset.coco import check_masks, read_coco
from shaftpose.dataset.coco_folder import copy_folder
from shaftpose.dataset.coco_images import load_square

OUTLINE = [10.0, 5.0, 30.0, 5.0, 30.0, 35.0, 10.0, 35.0]
BOX = [10.0, 5.0, 20.0, 30.0]
# Column by column of 40: rows 5 to 34 of columns 10 to 29.
COUNTS = [405, *([30, 10] * 19), 30, 2400 - 405 - 20 * 30 - 19 * 10]


def cvat(*names: str) -> dict[str, Any]:
    """CVAT's `COCO 1.0`: names relative to `images/`, ids from 1, one category."""
    extra = {"license": 0, "flickr_url": "", "coco_url": "", "date_captured": 0}
    shaft = {"category_id": 1, "area": 600.0, "bbox": BOX, "iscrowd": 0}
    return {
        "licenses": [{"name": "", "id": 0, "url": ""}],
        "info": {"contributor": "", "date_created": "", "url": "", "version": "", "year": ""},
        "categories": [{"id": 1, "name": "grasper", "supercategory": ""}],
        "images": [
            {"id": n, "width": 60, "height": 40, "file_name": name, **extra}
            for n, name in enumerate(names, start=1)
        ],
        "annotations": [
            {
                "id": n,
                "image_id": n,
                "segmentation": [OUTLINE],
                "attributes": {"occluded": n > 1},
                **shaft,
            }
            for n in range(1, len(names) + 1)
        ],
    }


def label_studio(*names: str) -> dict[str, Any]:
    """Label Studio's `COCO`: ids from 0, no attributes, two categories."""
    return {
        "images": [
            {"width": 60, "height": 40, "id": n, "file_name": name} for n, name in enumerate(names)
        ],
        "categories": [{"id": 0, "name": "Hook"}, {"id": 1, "name": "Scissors"}],
        "annotations": [
            {
                "id": n,
                "image_id": n,
                "category_id": n % 2,
                "segmentation": [OUTLINE],
                "bbox": BOX,
                "ignore": 0,
                "iscrowd": 0,
                "area": 600.0,
            }
            for n in range(len(names))
        ],
        "info": {"year": 2026, "version": "1.0", "contributor": "Label Studio"},
    }


def export(folder: Path, content: dict[str, Any], *files: str, part: str = "test") -> Path:
    """Write images and annotations; returns the path of the annotations."""
    for file in files:
        write_jpeg(np.full((40, 60, 3), 90, dtype=np.uint8), folder / "images" / file)
    path = folder / f"{part}.json"
    path.write_text(json.dumps(content))
    return path


def test_cvats_export_is_read(tmp_path: Path) -> None:
    files = ("case 1/frame_000001.PNG", "frame_000000.jpg")
    path = export(tmp_path, cvat(*files), *files)
    images = read_coco(path)
    check_masks(images, path)
    assert {image.path for image in images} == {tmp_path / "images" / name for name in files}
    for image in images:
        np.testing.assert_array_equal(load_square(image, 40).boxes, [[0, 5, 20, 35]])
    assert [shaft.occluded for image in images for shaft in image.instruments] == [True, False]


@pytest.mark.parametrize(
    "prefix",
    [
        "images/",
        "images\\",
        "images\\1/",
        "",
        "/data/upload/1/",
        "../../label-studio/label-studio/media/upload/4/",
        "..\\..\\label-studio\\label-studio\\media\\upload\\4\\",
        "http://localhost:8080/data/upload/4/",
    ],
)
def test_label_studios_names_lead_to_the_images(tmp_path: Path, prefix: str) -> None:
    files = ("cb0618f6-a.jpg", "cb0618f6-b.jpg")
    path = export(tmp_path, label_studio(*(prefix + name for name in files)), *files)
    images = read_coco(path)
    check_masks(images, path)
    assert [image.path for image in images] == [tmp_path / "images" / name for name in files]
    assert [len(image.instruments) for image in images] == [1, 1]


def test_one_image_under_two_names_is_named(tmp_path: Path) -> None:
    path = export(tmp_path, label_studio("images/a.jpg", "../upload/2/a.jpg"), "a.jpg")
    with pytest.raises(
        InputError, match=r"images\[1\]\.file_name = '\.\./upload/2/a\.jpg': listed"
    ):
        read_coco(path)


def test_boxes_without_an_outline_are_enough_for_training(tmp_path: Path) -> None:
    content = cvat("a.jpg")
    content["annotations"][0]["segmentation"] = []
    path = export(tmp_path, content, "a.jpg")
    (image,) = read_coco(path)
    assert [shaft.mask for shaft in image.instruments] == [None]
    with pytest.raises(InputError, match=r"a\.jpg in the box .*`segmentation`"):
        check_masks([image], path)


def test_masks_of_cvats_brush_are_run_lengths_marked_as_crowds(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    content = cvat("a.jpg")
    content["annotations"][0] |= {"segmentation": {"counts": COUNTS, "size": [40, 60]}}
    brush = content["annotations"][0] | {"iscrowd": 1}
    path = export(tmp_path, content | {"annotations": [brush]}, "a.jpg")
    with caplog.at_level(logging.WARNING):
        (image,) = read_coco(path)
    assert image.instruments == ()
    assert "left out 1 annotations with iscrowd 1" in caplog.text
    assert "set iscrowd to 0" in caplog.text
    export(tmp_path, content)  # with iscrowd 0
    (image,) = read_coco(path)
    expected = np.zeros((40, 40), dtype=bool)
    expected[5:35, :20] = True  # the square begins at column 10
    np.testing.assert_array_equal(load_square(image, 40).masks, [expected])


def test_an_export_is_copied_and_read_again(tmp_path: Path) -> None:
    source, out = tmp_path / "source", tmp_path / "out"
    export(source, cvat("a.jpg"), "a.jpg", part="train")
    export(source, label_studio("../upload/2/b.jpg"), "b.jpg", part="test")
    copy_folder(source, out)
    shutil.rmtree(source)
    for part, name in (("train", "a.jpg"), ("test", "b.jpg")):
        (image,) = read_coco(out / f"{part}.json")
        assert image.path == out / "images" / name
