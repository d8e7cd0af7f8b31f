"""Pixels of images without poses, and the crop to a square."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.images import write_jpeg
from shaftpose.core.instruments import TOOL, TOOL_OR_SHAFT, UNKNOWN
from shaftpose.core.masks import mask_box
from shaftpose.dataset.coco_images import (
    CocoImage,
    CocoInstrument,
    CocoTool,
    load_frame,
    load_square,
    read_pixels,
)
from shaftpose.dataset.compressed_masks import CompressedMask
from tests.dataset.coco_files import write_image


def test_pixels_of_another_size_than_stated_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    write_image(path, 50, 40)
    assert read_pixels(CocoImage(path, 50, 40, ())).shape == (40, 50, 3)
    with pytest.raises(InputError, match="50 x 40 px.*40 x 50") as caught:
        read_pixels(CocoImage(path, 40, 50, ()))
    assert str(caught.value).startswith(f"{path}: ")


def test_damaged_pixels_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    write_image(path, 50, 40)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(InputError, match="not a readable image") as caught:
        read_pixels(CocoImage(path, 50, 40, ()))
    assert str(caught.value).startswith(f"{path}: ")


def wide_image(folder: Path, *instruments: CocoInstrument) -> CocoImage:
    """1280 x 720: the square starts at column (1280 - 720) / 2 = 280; the scale is 299 / 720."""
    path = folder / "wide.jpg"
    write_image(path, 1280, 720)
    return CocoImage(path, 1280, 720, instruments)


def box_only(*box: float) -> CocoInstrument:
    x0, y0, x1, y1 = box
    return CocoInstrument((x0, y0, x1, y1), None, occluded=False)


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


def test_an_occluded_shaft_outside_of_the_square_does_not_count(tmp_path: Path) -> None:
    outside = CocoInstrument((0, 0, 100, 100), None, occluded=True)
    image = wide_image(tmp_path, outside, box_only(640, 360, 760, 720))
    assert not load_square(image, 299).occluded


def test_the_square_of_an_empty_image(tmp_path: Path) -> None:
    sample = load_square(wide_image(tmp_path), 299)
    assert sample.boxes.shape == (0, 4)
    assert sample.masks == ()


def masked(mask: NDArray[np.bool_], *box: float) -> CocoInstrument:
    """A shaft whose annotated box is the extent of its mask, unless another one is given."""
    x0, y0, x1, y1 = box or mask_box(mask)
    return CocoInstrument((x0, y0, x1, y1), CompressedMask.of(mask), occluded=True)


def test_the_square_moves_masks(tmp_path: Path) -> None:
    mask = np.zeros((720, 1280), dtype=bool)
    mask[360:720, 640:760] = True
    sample = load_square(wide_image(tmp_path, masked(mask)), 299)
    # As without a mask: x from 149.5 to 199.333, y from 149.5 to 299.
    np.testing.assert_allclose(sample.boxes, [[149.5, 149.5, 598 / 3, 299]])
    np.testing.assert_allclose(mask_box(sample.masks[0]), sample.boxes[0], atol=1)
    assert sample.occluded


def test_a_mask_is_enlarged(tmp_path: Path) -> None:
    write_image(tmp_path / "a.jpg", 60, 40)
    mask = np.zeros((40, 60), dtype=bool)
    mask[5:20, 20:50] = True  # the square begins at column 10
    sample = load_square(CocoImage(tmp_path / "a.jpg", 60, 40, (masked(mask),)), 80)
    np.testing.assert_allclose(sample.boxes, [[20, 10, 80, 40]])
    expected = np.zeros((80, 80), dtype=bool)
    expected[10:40, 20:80] = True
    np.testing.assert_array_equal(sample.masks, [expected])


def test_a_shaft_whose_mask_is_beside_the_square_is_dropped(tmp_path: Path) -> None:
    beside = np.zeros((720, 1280), dtype=bool)
    beside[:, 1000:] = True  # the square ends there
    image = wide_image(tmp_path, masked(beside, 0, 0, 1280, 720), box_only(640, 360, 760, 720))
    sample = load_square(image, 299)
    assert len(sample.boxes) == len(sample.masks) == 1
    assert not sample.occluded


def test_axes_follow_the_central_square(tmp_path: Path) -> None:
    write_jpeg(np.full((100, 200, 3), 90, dtype=np.uint8), tmp_path / "a.jpg")
    axis = ((150.0, 20.0), (190.0, 60.0))  # ends outside of the square, columns 50 to 150
    shaft = CocoInstrument((100.0, 10.0, 190.0, 60.0), None, occluded=False, axis=axis)
    square = load_square(CocoImage(tmp_path / "a.jpg", 200, 100, (shaft,)), 50)
    np.testing.assert_allclose(square.axes, [[[50, 10], [70, 30]]])


def rectangle(x0: int, y0: int, x1: int, y1: int) -> NDArray[np.bool_]:
    """A mask of 120 x 80 px."""
    mask = np.zeros((80, 120), dtype=bool)
    mask[y0:y1, x0:x1] = True
    return mask


def frame(folder: Path, **parts: Any) -> CocoImage:
    write_image(folder / "frame.jpg", 120, 80)
    return CocoImage(folder / "frame.jpg", 120, 80, **{"instruments": ()} | parts)


def test_the_square_leaves_out_tools_whose_shaft_is_unknown(tmp_path: Path) -> None:
    known = CocoTool(CompressedMask.of(rectangle(20, 0, 40, 80)), shaft_known=True)
    unknown = CocoTool(CompressedMask.of(rectangle(60, 20, 80, 40)), shaft_known=False)
    square = load_square(frame(tmp_path, tools=(known, unknown)), 80)
    assert square.left_out is not None
    # The square starts at column 20.
    np.testing.assert_array_equal(square.left_out, rectangle(40, 20, 60, 40)[:, :80])
    assert load_square(frame(tmp_path, tools=(known,)), 80).left_out is None


def test_a_frame_tells_shafts_from_the_rest_of_tools(tmp_path: Path) -> None:
    shaft = replace(masked(rectangle(0, 20, 60, 30)), axis=((60.0, 25.0), (0.0, 25.0)))
    tools = (
        CocoTool(CompressedMask.of(rectangle(100, 0, 120, 80)), shaft_known=False),
        CocoTool(CompressedMask.of(rectangle(0, 20, 80, 30)), shaft_known=True),
    )
    loaded = load_frame(frame(tmp_path, instruments=(shaft,), tools=tools), 80)
    expected = 1 * rectangle(0, 20, 60, 30)
    expected[rectangle(60, 20, 80, 30)] = TOOL
    expected[rectangle(100, 0, 120, 80)] = TOOL_OR_SHAFT
    np.testing.assert_array_equal(loaded.instances, expected)
    assert loaded.rgb.shape == (80, 120, 3)
    assert loaded.tips_px.tolist() == [[60, 25]]
    assert loaded.field is None


def test_a_frame_is_scaled_as_a_whole_and_never_enlarged(tmp_path: Path) -> None:
    shaft = replace(masked(rectangle(20, 20, 60, 40)), axis=((60.0, 30.0), (np.nan, np.nan)))
    whole = CocoTool(CompressedMask.of(rectangle(20, 20, 80, 40)), shaft_known=True)
    corners = ((10.0, 0.0), (110.0, 0.0), (110.0, 80.0), (10.0, 80.0))
    image = frame(tmp_path, instruments=(shaft,), tools=(whole,), field=corners)
    half = load_frame(image, 40)
    assert half.rgb.shape == (40, 60, 3)
    assert half.boxes.tolist() == [[10, 10, 30, 20]]
    np.testing.assert_array_equal(half.tips_px, [[30, 15]])
    assert mask_box(half.instances == 1) == (10, 10, 30, 20)
    assert mask_box(half.instances == TOOL) == (30, 10, 40, 20)
    assert half.field is not None
    assert mask_box(half.field) == (5, 0, 55, 40)
    assert load_frame(image, 1000).rgb.shape == (80, 120, 3)


def test_jaws_may_be_in_front_of_a_tip_where_no_tool_is_outlined(tmp_path: Path) -> None:
    """A shaft 8 px wide, its tip at 60, 40: 2.5 widths are 20 px."""
    shaft = replace(masked(rectangle(0, 36, 60, 44)), axis=((60.0, 40.0), (0.0, 40.0)))
    instances = load_frame(frame(tmp_path, instruments=(shaft,)), 80).instances
    assert mask_box(instances == 1) == (0, 36, 60, 44)
    assert mask_box(instances == UNKNOWN) == (60, 20, 80, 60)  # half a disc
    assert (instances == UNKNOWN).sum() == pytest.approx(np.pi * 20**2 / 2, rel=0.02)


def test_jaws_may_be_in_front_of_a_shaft_without_a_mask(tmp_path: Path) -> None:
    shaft = replace(box_only(0, 36, 60, 44), axis=((60.0, 40.0), (0.0, 40.0)))
    instances = load_frame(frame(tmp_path, instruments=(shaft,)), 80).instances
    ahead = rectangle(60, 0, 120, 80) == 1
    assert mask_box((instances == UNKNOWN) & ahead) == (60, 20, 80, 60)
    assert mask_box(instances == UNKNOWN) == (0, 20, 80, 60)  # its box, and half a disc
    tool = CocoTool(CompressedMask.of(rectangle(0, 36, 70, 44)), shaft_known=False)
    outlined = load_frame(frame(tmp_path, instruments=(shaft,), tools=(tool,)), 80).instances
    assert mask_box(outlined == UNKNOWN) == (0, 36, 60, 44)


def test_crowds_and_shafts_without_a_mask_are_unknown_in_a_frame(tmp_path: Path) -> None:
    parts = {"instruments": (box_only(10, 10, 30, 20),), "crowds": (box_only(50, 40, 70, 60),)}
    loaded = load_frame(frame(tmp_path, **parts), 80)
    expected = UNKNOWN * (1 * rectangle(10, 10, 30, 20) + rectangle(50, 40, 70, 60))
    np.testing.assert_array_equal(loaded.instances, expected)
    assert loaded.boxes.shape == (0, 4)
    assert loaded.tips_px.shape == (0, 2)
