"""Digests of images without poses: those of what a COCO file means."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.core.images import write_jpeg
from shaftpose.dataset.coco import read_coco
from shaftpose.training.fingerprint import annotated_digest

Content = dict[str, Any]


def content() -> Content:
    """One image with one shaft."""
    polygon = [10, 5, 30, 5, 30, 35, 10, 35]
    shaft = {"image_id": 1, "bbox": [10, 5, 20, 30], "segmentation": [polygon]}
    shaft["attributes"] = {"tip": [12, 7]}
    image = {"id": 1, "file_name": "a.jpg", "width": 60, "height": 40}
    return {"images": [image], "annotations": [shaft]}


def digest(folder: Path, text: str) -> str:
    if not (folder / "a.jpg").exists():
        write_jpeg(np.full((40, 60, 3), 90, dtype=np.uint8), folder / "a.jpg")
    (folder / "train.json").write_text(text)
    return annotated_digest(read_coco(folder / "train.json"))


def test_the_wording_of_a_file_does_not_count(tmp_path: Path) -> None:
    same = content() | {"info": {"description": "another"}}
    same["images"][0]["id"] = same["annotations"][0]["image_id"] = 7
    assert digest(tmp_path, json.dumps(same, indent=2)) == digest(tmp_path, json.dumps(content()))


def moved_box(shaft: Content) -> None:
    shaft["bbox"][0] = 11


def moved_mask(shaft: Content) -> None:
    shaft["segmentation"][0][0] = 12


def moved_tip(shaft: Content) -> None:
    shaft["attributes"]["tip"][0] = 13


def crowd(shaft: Content) -> None:
    shaft["iscrowd"] = 1


@pytest.mark.parametrize("change", [moved_box, moved_mask, moved_tip, crowd])
def test_a_change_of_its_meaning_counts(tmp_path: Path, change: Callable[[Content], None]) -> None:
    changed = content()
    change(changed["annotations"][0])
    assert digest(tmp_path, json.dumps(changed)) != digest(tmp_path, json.dumps(content()))


def test_the_pixels_of_images_count_and_no_other_bytes(tmp_path: Path) -> None:
    before = digest(tmp_path, json.dumps(content()))
    (tmp_path / "a.jpg").write_bytes((tmp_path / "a.jpg").read_bytes() + b" ")
    assert digest(tmp_path, json.dumps(content())) == before
    write_jpeg(np.full((40, 60, 3), 91, dtype=np.uint8), tmp_path / "a.jpg")
    assert digest(tmp_path, json.dumps(content())) != before
