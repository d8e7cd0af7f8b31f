"""Real images: what a COCO file may hold, the crop to a square, and the way back to a file."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from shaftpose.dataset.coco import (
    RealImage,
    RealInstrument,
    RealSample,
    load_square,
    mask_polygons,
    polygon_mask,
    read_coco,
    write_coco,
)
from shaftpose.errors import InputError
from shaftpose.images import write_jpeg


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


def test_a_file_is_read_in_the_order_of_names(tmp_path: Path) -> None:
    path = write_dataset(tmp_path, coco_content())
    a, b = read_coco(path)
    assert (a.path, a.width, a.height) == (tmp_path / "images" / "a.jpg", 50, 40)
    assert a.instruments == ()
    assert not a.occluded
    # x, y, width, height 10, 5, 20, 30 is 10, 5, 30, 35.
    assert [shaft.box for shaft in b.instruments] == [(10, 5, 30, 35), (0, 0, 60, 40)]
    polygons = b.instruments[0].polygons
    np.testing.assert_array_equal(polygons, [[[10, 5], [30, 5], [30, 35], [10, 35]]])
    assert b.instruments[1].polygons == ()
    assert [shaft.occluded for shaft in b.instruments] == [True, False]
    assert b.occluded


@pytest.mark.parametrize(
    "box",
    [
        [-1, 5, 20, 30],
        [10, -1, 20, 30],
        [41, 5, 20, 30],  # 41 + 20 = 61 > 60
        [10, 11, 20, 30],  # 11 + 30 = 41 > 40
        [10, 5, 0, 30],
        [10, 5, 20, -3],
    ],
)
def test_a_box_outside_its_image_is_named(tmp_path: Path, box: list[int]) -> None:
    content = coco_content()
    content["annotations"][0]["bbox"] = box
    message = complaint(write_dataset(tmp_path, content))
    assert str(box) in message
    assert "b.jpg" in message
    assert "60 x 40" in message


def test_a_missing_image_is_named(tmp_path: Path) -> None:
    path = write_dataset(tmp_path, coco_content())
    (tmp_path / "images" / "a.jpg").unlink()
    assert str(tmp_path / "images" / "a.jpg") in complaint(path)


def test_an_annotation_of_an_unlisted_image_is_named(tmp_path: Path) -> None:
    content = coco_content()
    content["annotations"][1]["image_id"] = 77
    assert "annotation 2 names image 77" in complaint(write_dataset(tmp_path, content))


@pytest.mark.parametrize("text", ["", "{", "images: []"])
def test_no_json_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "test.json"
    path.write_text(text)
    assert "no JSON" in complaint(path)


@pytest.mark.parametrize("content", [{"images": []}, {"annotations": []}, [], 3])
def test_missing_lists_are_named(tmp_path: Path, content: object) -> None:
    assert "lacks `images` or `annotations`" in complaint(write_dataset(tmp_path, content))


@pytest.mark.parametrize(
    ("part", "key"),
    [("images", "width"), ("images", "file_name"), ("annotations", "bbox"),
     ("annotations", "image_id")],
)  # fmt: skip
def test_a_missing_key_of_an_entry_is_named(tmp_path: Path, part: str, key: str) -> None:
    content = coco_content()
    del content[part][0][key]
    assert key in complaint(write_dataset(tmp_path, content))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert "cannot be read" in complaint(tmp_path / "test.json")


def wide_image(folder: Path, *instruments: RealInstrument) -> RealImage:
    """1280 x 720: the square starts at column (1280 - 720) / 2 = 280; the scale is 299 / 720."""
    path = folder / "wide.jpg"
    write_image(path, 1280, 720)
    return RealImage(path, 1280, 720, instruments)


def box_only(*box: float) -> RealInstrument:
    x0, y0, x1, y1 = box
    return RealInstrument((x0, y0, x1, y1), (), occluded=False)


def test_the_square_moves_boxes_by_hand(tmp_path: Path) -> None:
    # x: (640 - 280) 299 / 720 = 149.5, (760 - 280) 299 / 720 = 199.333;
    # y: 360 * 299 / 720 = 149.5, 720 -> 299.
    sample = load_square(wide_image(tmp_path, box_only(640, 360, 760, 720)), 299)
    assert sample.rgb.shape == (299, 299, 3)
    np.testing.assert_allclose(sample.boxes, [[149.5, 149.5, 598 / 3, 299]])


def test_the_square_cuts_and_drops_boxes(tmp_path: Path) -> None:
    image = wide_image(
        tmp_path,
        box_only(180, 72, 580, 144),  # 300 of 400 columns remain: cut at 280
        box_only(0, 0, 270, 100),  # left of the square
        box_only(1000, 0, 1280, 100),  # its left edge touches the square's right one
        box_only(201, 0, 301, 100),  # 21 of 100 columns: more than a fifth, kept
        box_only(199, 0, 299, 100),  # 19 of 100 columns: dropped
    )
    # 144 * 299 / 720 = 59.8, 72 -> 29.9, (580 - 280) -> 124.583; 21 -> 8.72083, 100 -> 41.5278.
    expected = [[0, 29.9, 124.58333, 59.8], [0, 0, 8.72083, 41.52778]]
    sample = load_square(image, 299)
    np.testing.assert_allclose(sample.boxes, expected, atol=1e-5)
    assert len(sample.masks) == 2


def test_the_square_of_an_empty_image(tmp_path: Path) -> None:
    sample = load_square(wide_image(tmp_path), 299)
    assert sample.boxes.shape == (0, 4)
    assert sample.masks == ()


def test_the_square_moves_polygons(tmp_path: Path) -> None:
    corners = np.array([[640, 360], [760, 360], [760, 720], [640, 720]], dtype=float)
    shaft = RealInstrument((640, 360, 760, 720), (corners,), occluded=True)
    sample = load_square(wide_image(tmp_path, shaft), 299)
    rows, columns = np.nonzero(sample.masks[0])
    # The box of 149.5 .. 199.3 and 149.5 .. 299 px, to a pixel.
    np.testing.assert_allclose([columns.min(), columns.max() + 1], [149.5, 199.3], atol=1)
    np.testing.assert_allclose([rows.min(), rows.max() + 1], [149.5, 299], atol=1)
    assert sample.occluded


def blobs(rng: np.random.Generator, size: int) -> np.ndarray:
    """A union of discs and ellipses, with its holes filled and without specks at the border."""
    mask = np.zeros((size, size), dtype=np.uint8)
    for _ in range(rng.integers(1, 6)):
        centre = tuple(int(c) for c in rng.integers(-5, size + 5, 2))
        axes = tuple(int(a) for a in rng.integers(2, 25, 2))
        cv2.ellipse(mask, centre, axes, float(rng.uniform(0, 180)), 0, 360, (1,), -1)
        cv2.circle(mask, tuple(int(c) for c in rng.integers(0, size, 2)), 4, (1,), -1)
    outside = np.zeros((size + 2, size + 2), dtype=np.uint8)
    outside[1:-1, 1:-1] = mask
    cv2.floodFill(outside, None, (0, 0), (2,))
    filled = (outside != 2)[1:-1, 1:-1].astype(np.uint8)
    _, parts, stats, _ = cv2.connectedComponentsWithStats(filled, connectivity=8)
    return filled.astype(bool) & (stats[parts, cv2.CC_STAT_AREA] >= 3)


@pytest.mark.parametrize("seed", range(40))
def test_polygons_of_a_mask_give_the_mask_again(seed: int) -> None:
    mask = blobs(np.random.default_rng(seed), 80)
    assert mask.any()
    polygons = tuple(np.array(points).reshape(-1, 2) for points in mask_polygons(mask))
    np.testing.assert_array_equal(polygon_mask(polygons, 80), mask)


def test_specks_are_no_polygons() -> None:
    # COCO's polygons have three points or more: a part of one or two pixels is left out.
    mask = np.zeros((20, 20), dtype=bool)
    mask[3, 3] = mask[8, 8:10] = mask[12, 5:8] = True
    (points,) = mask_polygons(mask)
    assert {*zip(points[::2], points[1::2], strict=True)} == {(5.5, 12.5), (6.5, 12.5), (7.5, 12.5)}


def test_polygon_mask_of_a_triangle() -> None:
    # Half of 40 x 40: 800 px, but for the pixels of the border, of which there are about 140.
    mask = polygon_mask((np.array([[5.0, 5.0], [45.0, 5.0], [5.0, 45.0]]),), 60)
    assert abs(int(mask.sum()) - 800) < 140
    assert mask[10, 10]
    assert not mask[40, 40]


def test_polygon_mask_of_a_square_on_pixel_edges() -> None:
    # COCO's polygons lie on pixel edges: 10 .. 20 holds the ten pixels 10 to 19.
    square = np.array([[10.0, 10.0], [20.0, 10.0], [20.0, 20.0], [10.0, 20.0]])
    expected = np.zeros((30, 30), dtype=bool)
    expected[10:20, 10:20] = True
    np.testing.assert_array_equal(polygon_mask((square,), 30), expected)


def test_no_polygon_is_no_mask() -> None:
    assert not polygon_mask((), 20).any()
    assert mask_polygons(np.zeros((20, 20), dtype=bool)) == []


def square_samples() -> list[tuple[str, RealSample]]:
    """Two images of 64 px: one with two shafts, hidden in part, and one with none."""
    masks = [np.zeros((64, 64), dtype=bool), np.zeros((64, 64), dtype=bool)]
    masks[0][10:20, 5:60] = True
    masks[1][30:64, 40:50] = True
    rgb = np.full((64, 64, 3), 70, dtype=np.uint8)
    boxes = np.array([[5, 10, 60, 20], [40, 30, 50, 64]], dtype=float)
    full = RealSample(rgb, boxes, tuple(masks), occluded=True)
    return [
        ("images/a.jpg", full),
        ("images/b.jpg", RealSample(rgb, np.zeros((0, 4)), (), occluded=False)),
    ]


def write_samples(folder: Path, with_masks: bool) -> Path:
    for name, sample in square_samples():
        write_jpeg(sample.rgb, folder / name)
    path = folder / "train.json"
    write_coco(path, square_samples(), with_masks, "two images")
    return path


def test_written_samples_are_read_again(tmp_path: Path) -> None:
    path = write_samples(tmp_path, with_masks=True)
    images = read_coco(path)
    for image, (name, written) in zip(images, square_samples(), strict=True):
        read = load_square(image, 64)
        assert image.path == tmp_path / name
        np.testing.assert_allclose(read.boxes, written.boxes)
        np.testing.assert_array_equal(read.masks, written.masks)
        assert read.occluded == written.occluded
        assert np.abs(read.rgb.astype(int) - 70).max() <= 2


def test_a_written_file_is_coco(tmp_path: Path) -> None:
    content = json.loads(write_samples(tmp_path, with_masks=True).read_text())
    assert content["info"]["description"] == "two images"
    assert [entry["id"] for entry in content["images"]] == [1, 2]
    first, second = content["annotations"]
    assert (first["id"], second["id"]) == (1, 2)
    assert first["image_id"] == second["image_id"] == 1
    assert first["category_id"] == content["categories"][0]["id"]
    # 40, 30, 50, 64 is 10 wide and 34 high: 340 px.
    assert second["bbox"] == [40, 30, 10, 34]
    assert second["area"] == 340


def test_without_masks_there_are_boxes_only(tmp_path: Path) -> None:
    path = write_samples(tmp_path, with_masks=False)
    annotations = json.loads(path.read_text())["annotations"]
    assert [annotation["segmentation"] for annotation in annotations] == [[], []]
    image = read_coco(path)[0]
    assert [shaft.polygons for shaft in image.instruments] == [(), ()]
    np.testing.assert_allclose(load_square(image, 64).boxes, square_samples()[0][1].boxes)
