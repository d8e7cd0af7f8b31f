"""Polygons and run lengths of COCO files as masks."""

import json
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.dataset.coco import check_masks, read_coco
from shaftpose.dataset.coco_images import load_square
from shaftpose.dataset.compressed_masks import CompressedMask
from tests.dataset.coco_files import coco_content, complaint, write_dataset, write_image


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
        ([rectangle(50, 10, 60, 20)], slice(0), slice(0)),  # next to the image
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
