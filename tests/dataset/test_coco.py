"""Content of COCO files, read and written."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.images import write_jpeg
from shaftpose.core.masks import mask_box
from shaftpose.dataset.coco import check_masks, read_coco, write_coco
from shaftpose.dataset.coco_images import CocoTool, SquareImage, load_square
from shaftpose.dataset.compressed_masks import CompressedMask
from tests.dataset.coco_files import coco_content, complaint, write_dataset, write_image


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


def test_a_box_of_corners_is_named(tmp_path: Path) -> None:
    content = coco_content()
    content["annotations"][0]["bbox"] = [10, 5, 30, 35]  # x1, y1 in place of 20, 30
    message = complaint(write_dataset(tmp_path, content))
    assert "annotations[0]: the box [10.0, 5.0, 30.0, 35.0] holds the corners" in message
    assert "write x, y, width, height: [10.0, 5.0, 20.0, 30.0]" in message
    content["annotations"][0] |= {  # as x, y, width, height, it leaves the image
        "bbox": [40, 5, 55, 35], "segmentation": [[40, 5, 55, 5, 55, 35, 40, 35]]
    }  # fmt: skip
    message = complaint(write_dataset(tmp_path, content))
    assert "write x, y, width, height: [40.0, 5.0, 15.0, 30.0]" in message


def test_a_missing_image_is_named(tmp_path: Path) -> None:
    path = write_dataset(tmp_path, coco_content())
    (tmp_path / "images" / "a.jpg").unlink()
    assert f"images[1].file_name = 'images/a.jpg': no such file in {tmp_path}" in complaint(path)


def test_an_image_of_another_folder_is_not_taken(tmp_path: Path) -> None:
    content = coco_content()
    content["images"][1]["file_name"] = "operation_9/a.jpg"  # images/a.jpg is another one
    message = complaint(write_dataset(tmp_path, content))
    assert "images[1].file_name = 'operation_9/a.jpg': no such file" in message


def test_backslashes_part_folders(tmp_path: Path) -> None:
    content = coco_content()
    content["images"][1]["file_name"] = "operation_9\\a.jpg"
    path = write_dataset(tmp_path, coco_content())
    (tmp_path / "images/operation_9").mkdir()
    write_image(tmp_path / "images/operation_9/a.jpg", 50, 40)
    path.write_text(json.dumps(content))
    assert tmp_path / "images/operation_9/a.jpg" in [image.path for image in read_coco(path)]


@pytest.mark.parametrize("side", [10**7, 10**40])
def test_an_image_that_is_too_large_is_named(tmp_path: Path, side: int) -> None:
    content = coco_content()
    content["images"][1]["height"] = side
    words = complaint(write_dataset(tmp_path, content))
    assert f"images[1]: states {content['images'][1]['width']} x {side} px, more than" in words


@pytest.mark.parametrize("text", ["", "{", "images: []", "\x00", "[" * 10_000 + "]" * 10_000])
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


def tools_content() -> dict[str, Any]:
    """b.jpg shows a tool whose shaft is outlined, one whose shaft is not, and jaws alone."""
    content = coco_content()
    content["categories"] = [{"id": 1, "name": "shaft"}, {"id": 7, "name": "tool"}]
    first, second = content["annotations"]
    first["category_id"] = 1
    whole = {"image_id": 4, "category_id": 7, "bbox": [10, 5, 30, 30]}
    square = [[10, 5, 40, 5, 40, 35, 10, 35]]
    content["annotations"] = [
        first,
        whole | {"segmentation": square, "attributes": {"shaft": "outlined"}},
        whole | {"segmentation": square},
        whole | {"segmentation": square, "attributes": {"shaft": "none"}},
    ]
    return content


@pytest.mark.parametrize("name", ["tool", "Tool"])
def test_annotations_of_the_category_tool_are_whole_tools(name: str, tmp_path: Path) -> None:
    content = tools_content()
    content["categories"][1]["name"] = name
    image = read_coco(write_dataset(tmp_path, content))[1]
    expected = np.zeros((40, 60), dtype=bool)
    expected[5:35, 10:40] = True
    mask = CompressedMask.of(expected)
    assert [shaft.box for shaft in image.instruments] == [(10, 5, 30, 35)]
    assert image.tools == tuple(CocoTool(mask, shaft_known=one) for one in (True, False, True))


def test_categories_of_other_names_are_shafts(tmp_path: Path) -> None:
    content = tools_content()
    content["categories"][1]["name"] = "grasper"
    image = read_coco(write_dataset(tmp_path, content))[1]
    assert (len(image.instruments), image.tools) == (4, ())


def test_a_tool_without_a_mask_is_named(tmp_path: Path) -> None:
    content = tools_content()
    content["annotations"][2]["segmentation"] = []
    message = complaint(write_dataset(tmp_path, content))
    assert "annotations[2]: a `tool` without `segmentation`; add its polygons" in message


def test_the_visible_field_is_the_hull_of_its_polygons(tmp_path: Path) -> None:
    content = coco_content()
    content["images"][0]["view"] = [[0, 0, 20, 0, 20, 40, 0, 40], [30, 10, 50, 20, 40, 21]]
    a, b = read_coco(write_dataset(tmp_path, content))
    assert a.field is None and b.field is not None
    # The line 20, 0 to 50, 20 passes x = 30 at y = 6.7, 20, 40 to 50, 20 passes x = 40 at 26.7.
    assert set(b.field) == {(0, 0), (20, 0), (50, 20), (20, 40), (0, 40)}


def test_a_view_that_is_no_polygon_is_named(tmp_path: Path) -> None:
    content = coco_content()
    content["images"][0]["view"] = [[0, 0, 20, 0, 20]]
    message = complaint(write_dataset(tmp_path, content))
    assert "image images/b.jpg: a polygon of `view` is not x and y of three points" in message


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


def test_an_image_is_of_its_operation_or_of_its_own(tmp_path: Path) -> None:
    content = coco_content()
    content["images"][0]["operation"] = "00021"
    a, b = read_coco(write_dataset(tmp_path, content))
    assert (a.operation, b.operation) == ("a", "00021")
