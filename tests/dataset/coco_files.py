"""Small COCO files for tests."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.images import write_jpeg
from shaftpose.dataset.coco import read_coco


def write_image(path: Path, width: int, height: int) -> None:
    write_jpeg(np.full((height, width, 3), 90, dtype=np.uint8), path)


def coco_content() -> dict[str, Any]:
    """Two images, listed against their names' order, and two shafts in b.jpg."""
    return {
        "images": [
            {"id": 4, "file_name": "images/b.jpg", "width": 60, "height": 40},
            {"id": 9, "file_name": "images/a.jpg", "width": 50, "height": 40},
        ],
        "annotations": [
            {
                "id": 1,
                "image_id": 4,
                "bbox": [10, 5, 20, 30],
                "segmentation": [[10, 5, 30, 5, 30, 35, 10, 35]],
                "attributes": {"occluded": True},
            },
            {"id": 2, "image_id": 4, "bbox": [0, 0, 60, 40]},  # as large as the image
        ],
    }


def write_dataset(folder: Path, content: object) -> Path:
    write_image(folder / "images" / "a.jpg", 50, 40)
    write_image(folder / "images" / "b.jpg", 60, 40)
    path = folder / "test.json"
    path.write_text(json.dumps(content))
    return path


def complaint(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_coco(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message
