"""COCO files: what they may hold, and the way back to a file."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.images import write_jpeg
from shaftpose.core.masks import mask_box
from shaftpose.dataset.coco import check_masks, read_coco, write_coco
from shaftpose.dataset.coco_images import SquareImage, load_square
from shaftpose.dataset.compressed_masks import CompressedMask


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
    # x, y, width, height 10, 5, 20, 30 is 10, 5, 30, 35.
    assert [shaft.box for shaft in b.instruments] == [(10, 5, 30, 35), (0, 0, 60, 40)]
    expected = np.zeros((40, 60), dtype=bool)
    expected[5:35, 10:30] = True
    assert [shaft.mask for shaft in b.instruments] == [CompressedMask.of(expected), None]
    assert [shaft.occluded for shaft in b.instruments] == [True, False]


@pytest.mark.parametrize(
    "box",
    [
        [-1.5, 5, 20, 30],
        [10, -2, 20, 30],
        [41.5, 5, 20, 30],  # 41.5 + 20 = 61.5 > 61
        [10, 12, 20, 30],  # 12 + 30 = 42 > 41
        [10, 5, 0, 30],
        [10, 5, 20, -3],
        [60, 5, 1, 30],  # nothing of it is in the image
    ],
)
def test_a_box_outside_its_image_is_named(tmp_path: Path, box: list[int]) -> None:
    content = coco_content()
    content["annotations"][0]["bbox"] = box
    message = complaint(write_dataset(tmp_path, content))
    assert str([float(number) for number in box]) in message
    assert "b.jpg" in message
    assert "60 x 40" in message


@pytest.mark.parametrize(
    ("box", "clipped"),
    [
        ([40.4, 5, 20, 30], (40.4, 5, 60, 35)),  # 60.4 -> 60
        ([-0.5, 10.5, 20, 30], (0, 10.5, 19.5, 40)),  # 40.5 -> 40
        ([-1, -1, 62, 42], (0, 0, 60, 40)),
    ],
)
def test_a_box_that_is_a_pixel_too_large_is_clipped(
    tmp_path: Path, box: list[float], clipped: tuple[float, ...]
) -> None:
    content = coco_content()
    content["annotations"][0]["bbox"] = box
    image = read_coco(write_dataset(tmp_path, content))[1]
    assert image.instruments[0].box == pytest.approx(clipped)


def test_a_missing_image_is_named(tmp_path: Path) -> None:
    path = write_dataset(tmp_path, coco_content())
    (tmp_path / "images" / "a.jpg").unlink()
    assert f"images[1].file_name = 'images/a.jpg': no such file in {tmp_path}" in complaint(path)


@pytest.mark.parametrize("text", ["", "{", "images: []", "\x00"])
def test_no_json_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "test.json"
    path.write_text(text)
    assert "no JSON" in complaint(path)


def test_bytes_that_are_no_text_are_named(tmp_path: Path) -> None:
    path = tmp_path / "test.json"
    path.write_bytes(b"\x81\x82\x83\x84")
    assert "no JSON" in complaint(path)


def test_a_byte_order_mark_is_read_over(tmp_path: Path) -> None:
    path = write_dataset(tmp_path, coco_content())
    path.write_text(path.read_text(), encoding="utf-8-sig")
    assert len(read_coco(path)) == 2


@pytest.mark.parametrize(
    ("content", "lacking"),
    [
        ({"images": []}, "annotations"),
        ({"annotations": []}, "images"),
        ({"images": {}, "annotations": []}, "images"),
        ({"images": [], "annotations": None}, "annotations"),
        ([], "images"),
        (3, "images"),
    ],
)
def test_missing_lists_are_named(tmp_path: Path, content: object, lacking: str) -> None:
    assert f"lacks the list `{lacking}`" in complaint(write_dataset(tmp_path, content))


def test_a_file_without_images_is_refused(tmp_path: Path) -> None:
    path = write_dataset(tmp_path, {"images": [], "annotations": []})
    assert "lists no image" in complaint(path)


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    assert "cannot be read (No such file" in complaint(tmp_path / "test.json")
    assert "cannot be read (Is a directory" in complaint(tmp_path)


@pytest.mark.parametrize(
    ("part", "key"),
    [
        ("images", "id"),
        ("images", "width"),
        ("images", "height"),
        ("images", "file_name"),
        ("annotations", "bbox"),
        ("annotations", "image_id"),
    ],
)
def test_a_missing_key_of_an_entry_is_named(tmp_path: Path, part: str, key: str) -> None:
    content = coco_content()
    del content[part][0][key]
    assert f"{part}[0].{key} is missing" in complaint(write_dataset(tmp_path, content))


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ("images", "id", None),
        ("images", "id", 4),  # that of the other image
        ("images", "width", 0),
        ("images", "height", None),
        ("images", "file_name", None),
        ("images", "file_name", "images/b.jpg"),  # the other image, once more
        ("images", "file_name", "images/./b.jpg"),
        ("images", "file_name", "../images/b.jpg"),  # the other image by another path
        ("images", "file_name", "/tmp/c.jpg"),
        ("images", "file_name", "images/../../c.jpg"),
        ("images", "file_name", "images/.."),
        ("images", "file_name", ""),
        ("annotations", "image_id", 77),
        ("annotations", "bbox", None),
        ("annotations", "bbox", [1, 2, 3]),
        ("annotations", "bbox", [1, 2, 3, 4, 5]),
        ("annotations", "bbox.2", [1, 2, "3", 4]),
        ("annotations", "bbox.0", [float("nan"), 2, 3, 4]),
        ("annotations", "segmentation", None),
        ("annotations", "segmentation", "b.png"),
        ("annotations", "attributes.occluded", {"occluded": "perhaps"}),
        ("annotations", "attributes.tip", {"tip": "here"}),
        ("annotations", "attributes.tail.0", {"tip": [1, 2], "tail": ["left", 3]}),
    ],
)
def test_a_wrong_value_of_an_entry_is_named(
    tmp_path: Path, part: str, key: str, value: object
) -> None:
    content = coco_content()
    content[part][1][key.partition(".")[0]] = value
    assert f"{part}[1].{key} = " in complaint(write_dataset(tmp_path, content))


@pytest.mark.parametrize("part", ["images", "annotations"])
def test_an_entry_that_holds_no_keys_is_named(tmp_path: Path, part: str) -> None:
    content = coco_content()
    content[part][1] = [1, 2]
    assert f"{part}[1] = [1, 2]" in complaint(write_dataset(tmp_path, content))


@pytest.mark.parametrize(
    "polygon",
    [
        [],
        [1, 2, 3, 4],  # two points
        [1, 2, 3, 4, 5, 6, 7],
        [1, 2, 3, 4, 5, float("inf")],
        [1, 2, 3, 4, 5, float("nan")],
        [1, 2, 3, 4, 5, -1e12],  # pycocotools would run out of memory
        [1, 2, 3, 4, 5, 10**400],  # no float holds it
        [1, 2, 3, 4, 5, None],
        [1, 2, 3, 4, 5, "six"],
        [[1, 2], [3, 4], [5, 6]],
        [[1, 2], [3]],
        {"x": 1},
        None,
    ],
)
def test_a_damaged_polygon_is_named(tmp_path: Path, polygon: object) -> None:
    content = coco_content()
    content["annotations"][0]["segmentation"].append(polygon)
    message = complaint(write_dataset(tmp_path, content))
    assert "annotations[0].segmentation[1]: " in message
    assert "x, y, x, y" in message


@pytest.mark.parametrize(
    ("polygon", "at"),
    [
        ([10, 5, 30, 35, 30, 5, 10, 35], "20.0, 20.0"),  # a bow tie
        ([10, 5, 30, 5, 30, 35, 20, 0, 10, 35], "21.4, 5.0"),  # 35 down to 0 over 10: 5 at 150 / 7
    ],
)
def test_a_polygon_that_crosses_itself_is_named(
    tmp_path: Path, polygon: list[int], at: str
) -> None:
    content = coco_content()
    content["annotations"][0]["segmentation"].append(polygon)
    message = complaint(write_dataset(tmp_path, content))
    assert "annotations[0].segmentation[1]: two of its sides cross at x, y = " + at in message


@pytest.mark.parametrize(
    "polygon",
    [
        [10, 5, 10, 5, 30, 5, 30, 35, 10, 35, 10, 5],  # corners stated twice
        [10, 5, 20, 5, 30, 5, 30, 35, 10, 35],  # a corner on a straight side
        [10, 5, 30, 5, 30, 35, 10, 35, 10, 5, 15, 10, 15, 30, 25, 30, 25, 10, 15, 10],  # a hole
        [10, 5, 30, 5, 30, 35, 20, 5, 10, 35],  # a corner that touches another side
        [10, 5, 30, 5, 30, 35, 30, 39, 30, 35, 10, 35],  # a thorn
    ],
)
def test_a_polygon_may_touch_itself(tmp_path: Path, polygon: list[int]) -> None:
    content = coco_content()
    content["annotations"][0]["segmentation"] = [polygon]
    shaft = read_coco(write_dataset(tmp_path, content))[1].instruments[0]
    assert shaft.mask is not None


def run_lengths(*counts: int, size: tuple[int, int] = (40, 60)) -> dict[str, object]:
    return {"counts": list(counts), "size": list(size)}


# Column by column of 40: rows 5 to 34 of columns 10 and 11, and nothing behind them.
BAR = 405, 30, 10, 30, 1925
# From the fourth on, a number is the difference to the one before the last: 405, 30, 10, 0, 1915.
# A character is 48 + five bits of it, the lowest first, + 32 if more follow; the last one's highest
# bit is the sign. 405: 21 + 32, 12. 30: 30 + 32, 0. 10. 0. 1915: 27 + 32, 27 + 32, 1.
COMPRESSED_BAR = "e<n0:0kk1"


@pytest.mark.parametrize("counts", [list(BAR), COMPRESSED_BAR])
def test_run_lengths_are_read(tmp_path: Path, counts: object) -> None:
    content = coco_content()
    content["annotations"][0]["segmentation"] = {"counts": counts, "size": [40, 60]}
    shaft = read_coco(write_dataset(tmp_path, content))[1].instruments[0]
    expected = np.zeros((40, 60), dtype=bool)
    expected[5:35, 10:12] = True
    assert shaft.mask == CompressedMask.of(expected)


@pytest.mark.parametrize(
    "segmentation",
    [
        run_lengths(405, 30, 10, 30, 1924),
        run_lengths(2500, -100),
        run_lengths(2400, size=(60, 40)),
        {"counts": [2400]},
        {"size": [40, 60]},
        {"counts": [1200.0, 1200.0], "size": [40, 60]},
        {"counts": 2400, "size": [40, 60]},
        {"counts": COMPRESSED_BAR, "size": [60, 40]},
        {"counts": COMPRESSED_BAR},
        {"counts": "e<n0:0jk1", "size": [40, 60]},  # the last number is one less
        {"counts": "e<n0:0lk1", "size": [40, 60]},  # and one more
        {"counts": "e<n0:0", "size": [40, 60]},
        {"counts": "e<n0:0kk", "size": [40, 60]},  # cut in the middle of a number
        {"counts": "e<n0:0kk1 ", "size": [40, 60]},
        {"counts": "e<n0:0kk\u00e91", "size": [40, 60]},
        {"counts": "", "size": [40, 60]},
    ],
)
def test_run_lengths_that_do_not_fill_the_image_are_named(
    tmp_path: Path, segmentation: object
) -> None:
    content = coco_content()
    content["annotations"][0]["segmentation"] = segmentation
    message = complaint(write_dataset(tmp_path, content))
    assert "annotations[0].segmentation: run lengths need the size [40, 60] of images/b.jpg" in (
        message
    )


def test_crowds_are_left_out_and_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    content = coco_content()
    content["annotations"][0] |= {"iscrowd": 1, "segmentation": {"counts": "eW41"}}
    content["annotations"][1]["iscrowd"] = 0
    path = write_dataset(tmp_path, content)
    image = read_coco(path)[1]
    assert [shaft.box for shaft in image.instruments] == [(0, 0, 60, 40)]
    assert [crowd.box for crowd in image.crowds] == [(10, 5, 30, 35)]
    assert f"{path}: left out 1 annotations with iscrowd 1" in caplog.text


def test_no_crowd_no_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    read_coco(write_dataset(tmp_path, coco_content()))
    assert caplog.text == ""


def test_a_shaft_without_a_mask_is_named_where_masks_are_needed(tmp_path: Path) -> None:
    path = write_dataset(tmp_path, coco_content())
    images = read_coco(path)
    check_masks(images[:1], path)  # a.jpg shows no shaft
    with pytest.raises(
        InputError, match=r"b\.jpg in the box \(0.*60.*40.*`segmentation`"
    ) as caught:
        check_masks(images, path)
    assert str(caught.value).startswith(f"{path}: ")


def test_the_box_of_an_oblique_shaft_is_that_of_what_remains(tmp_path: Path) -> None:
    """From corner to corner of 1920 x 1080, 40 px high: at column x around row 0.5625 x."""
    polygon = [0, -20, 1920, 1060, 1920, 1100, 0, 20]
    write_image(tmp_path / "a.jpg", 1920, 1080)
    content = {
        "images": [{"id": 1, "file_name": "a.jpg", "width": 1920, "height": 1080}],
        "annotations": [{"image_id": 1, "bbox": [0, 0, 1920, 1080], "segmentation": [polygon]}],
    }
    path = tmp_path / "test.json"
    path.write_text(json.dumps(content))
    sample = load_square(read_coco(path)[0], 299)
    # The square is columns 420 to 1500: 0.5625 * 420 - 20 = 216.25, 0.5625 * 1500 + 20 = 863.75.
    expected = np.array([0, 216.25, 1080, 863.75]) * 299 / 1080
    np.testing.assert_allclose(sample.boxes, [expected], atol=0.3)  # a pixel of the file is 0.28
    np.testing.assert_allclose(mask_box(sample.masks[0]), expected, atol=1)
    # The annotated box cut at the square would be all of it.
    assert 0.59 < np.prod(sample.boxes[0, 2:] - sample.boxes[0, :2]) / 299**2 < 0.61


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


def square_mask(folder: Path, segmentation: object) -> NDArray[np.bool_]:
    """The mask that a shaft of an image of 40 x 40 gets, whose central square is the image."""
    write_image(folder / "a.jpg", 40, 40)
    content = {
        "images": [{"id": 1, "file_name": "a.jpg", "width": 40, "height": 40}],
        "annotations": [{"image_id": 1, "bbox": [0, 0, 40, 40], "segmentation": segmentation}],
    }
    path = folder / "test.json"
    path.write_text(json.dumps(content))
    (image,) = read_coco(path)
    (mask,) = load_square(image, 40).masks
    return mask


def rectangle(x0: float, y0: float, x1: float, y1: float) -> list[float]:
    """A polygon in COCO's order."""
    return [x0, y0, x1, y0, x1, y1, x0, y1]


@pytest.mark.parametrize(
    ("polygons", "rows", "columns"),
    [
        # COCO's polygons lie on pixel edges: 10 .. 20 holds the ten pixels 10 to 19.
        ([rectangle(10, 12, 20, 30)], slice(12, 30), slice(10, 20)),
        ([rectangle(20, 30, 10, 12)], slice(12, 30), slice(10, 20)),  # from the other corner
        ([rectangle(0, 0, 40, 40)], slice(0, 40), slice(0, 40)),
        ([rectangle(0, 39, 40, 40)], slice(39, 40), slice(0, 40)),
        ([rectangle(39, 39, 40, 40)], slice(39, 40), slice(39, 40)),
        ([rectangle(-7, -9, 3, 55)], slice(0, 40), slice(0, 3)),
        ([rectangle(38, -2, 300, 5)], slice(0, 5), slice(38, 40)),
        ([rectangle(50, 10, 60, 20)], slice(0), slice(0)),  # beside the image
        # Those that overlap or touch are united.
        ([rectangle(5, 5, 15, 9), rectangle(10, 5, 22, 9)], slice(5, 9), slice(5, 22)),
        ([rectangle(5, 5, 15, 9), rectangle(15, 5, 22, 9)], slice(5, 9), slice(5, 22)),
    ],
)
def test_rectangles_on_pixel_edges(
    tmp_path: Path, polygons: list[list[float]], rows: slice, columns: slice
) -> None:
    expected = np.zeros((40, 40), dtype=bool)
    expected[rows, columns] = True
    np.testing.assert_array_equal(square_mask(tmp_path, polygons), expected)


def test_polygons_around_a_hole_leave_it(tmp_path: Path) -> None:
    halves = [
        [10, 10, 20, 10, 20, 14, 14, 14, 14, 26, 20, 26, 20, 30, 10, 30],
        [20, 10, 30, 10, 30, 30, 20, 30, 20, 26, 26, 26, 26, 14, 20, 14],
    ]
    expected = np.zeros((40, 40), dtype=bool)
    expected[10:30, 10:30] = True
    expected[14:26, 14:26] = False
    np.testing.assert_array_equal(square_mask(tmp_path, halves), expected)


@pytest.mark.parametrize(
    ("polygon", "pixels"),
    [
        (rectangle(10.5, 10.5, 20.5, 20.5), 100),  # corners in the centres of pixels
        (rectangle(10.3, 10.3, 20.3, 20.3), 100),
        ([5, 5, 35, 5, 5, 35], 435),  # half of 30 x 30 is 450; the oblique side is through centres
        ([2, 30, 30, 2, 36, 8, 8, 36], 336),  # an oblique shaft of 336 px
    ],
)
def test_the_pixels_on_the_border_of_a_polygon(
    tmp_path: Path, polygon: list[float], pixels: int
) -> None:
    assert square_mask(tmp_path, [polygon]).sum() == pixels


def column_runs(mask: NDArray[np.bool_]) -> dict[str, object]:
    """A mask as COCO's uncompressed run lengths, counted pixel by pixel."""
    counts, value = [0], False
    for pixel in mask.T.ravel().tolist():
        if pixel != value:
            counts.append(0)
            value = pixel
        counts[-1] += 1
    return {"counts": counts, "size": list(mask.shape)}


@pytest.mark.parametrize("seed", range(40))
def test_run_lengths_give_the_mask(tmp_path: Path, seed: int) -> None:
    mask = blobs(np.random.default_rng(seed), 40)
    np.testing.assert_array_equal(square_mask(tmp_path, column_runs(mask)), mask)
    np.testing.assert_array_equal(square_mask(tmp_path, asdict(CompressedMask.of(mask))), mask)


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        (slice(0, 40), slice(0, 40)),
        (slice(0, 1), slice(0, 40)),
        (slice(39, 40), slice(0, 40)),
        (slice(0, 40), slice(39, 40)),
        (slice(37, 40), slice(37, 40)),
        (slice(20, 21), slice(20, 23)),  # three pixels are the fewest of a part
    ],
)
def test_run_lengths_at_the_border(tmp_path: Path, rows: slice, columns: slice) -> None:
    mask = np.zeros((40, 40), dtype=bool)
    mask[rows, columns] = True
    np.testing.assert_array_equal(square_mask(tmp_path, column_runs(mask)), mask)


def test_holes_of_run_lengths_are_filled_and_specks_dropped(tmp_path: Path) -> None:
    mask = np.zeros((40, 40), dtype=bool)
    mask[5:20, 5:20] = True
    expected = mask.copy()
    mask[8:16, 8:16] = False
    mask[10:14, 10:14] = True  # a part in a hole
    mask[30, 30] = mask[0, 39] = mask[34:36, 20] = True  # specks
    mask[39, 0:3] = expected[39, 0:3] = True
    np.testing.assert_array_equal(square_mask(tmp_path, column_runs(mask)), expected)


def test_runs_may_be_empty(tmp_path: Path) -> None:
    # Rows 10 to 19 of column 0, cut in two by runs of no pixel.
    expected = np.zeros((40, 40), dtype=bool)
    expected[10:20, 0] = True
    runs = run_lengths(10, 4, 0, 6, 1580, 0, size=(40, 40))
    np.testing.assert_array_equal(square_mask(tmp_path, runs), expected)


def test_run_lengths_without_a_pixel_are_no_mask(tmp_path: Path) -> None:
    assert not square_mask(tmp_path, run_lengths(1600, size=(40, 40))).any()
    (image,) = read_coco(tmp_path / "test.json")
    np.testing.assert_array_equal(load_square(image, 40).boxes, [[0, 0, 40, 40]])
    with pytest.raises(InputError, match="`segmentation`"):
        check_masks([image], tmp_path / "test.json")


def test_a_tip_may_be_known_alone(tmp_path: Path) -> None:
    content = coco_content()
    content["annotations"][1]["attributes"] = {"tip": [20.0, 30.0]}
    _, wide = read_coco(write_dataset(tmp_path, content))  # its square is columns 10 to 50
    unknown = [np.nan, np.nan]
    expected = [[unknown, unknown], [[5, 15], unknown]]
    np.testing.assert_array_equal(load_square(wide, 20).axes, expected)


def test_a_tip_that_is_the_tail_is_named(tmp_path: Path) -> None:
    content = coco_content()
    content["annotations"][1]["attributes"] = {"tip": [20.0, 30.0], "tail": [20, 30]}
    message = complaint(write_dataset(tmp_path, content))
    assert "annotations[1]: tip and tail are the same point (20.0, 30.0)" in message


def square_samples() -> list[tuple[str, SquareImage]]:
    """Two images of 64 px: one with two shafts, hidden in part, and one with none."""
    masks = [np.zeros((64, 64), dtype=bool), np.zeros((64, 64), dtype=bool)]
    masks[0][10:20, 5:60] = True
    masks[1][30:64, 40:50] = True
    rgb = np.full((64, 64, 3), 70, dtype=np.uint8)
    boxes = np.array([[5, 10, 60, 20], [40, 30, 50, 64]], dtype=float)
    axes = np.array([[[5, 15], [60, 15]], [[np.nan, np.nan], [np.nan, np.nan]]])
    full = SquareImage(rgb, boxes, tuple(masks), axes, occluded=True)
    return [
        ("images/a.jpg", full),
        (
            "images/b.jpg",
            SquareImage(rgb, np.zeros((0, 4)), (), np.zeros((0, 2, 2)), occluded=False),
        ),
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
        np.testing.assert_allclose(read.axes, written.axes)
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
    mask = CompressedMask.of(square_samples()[0][1].masks[1])
    assert second["segmentation"] == {"size": [64, 64], "counts": mask.counts}


def test_without_masks_there_are_boxes_only(tmp_path: Path) -> None:
    path = write_samples(tmp_path, with_masks=False)
    annotations = json.loads(path.read_text())["annotations"]
    assert [annotation["segmentation"] for annotation in annotations] == [[], []]
    image = read_coco(path)[0]
    assert [shaft.mask for shaft in image.instruments] == [None, None]
    np.testing.assert_allclose(load_square(image, 64).boxes, square_samples()[0][1].boxes)
