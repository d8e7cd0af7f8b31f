from dataclasses import replace
from pathlib import Path

import numpy as np

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter, shard_name
from shaftpose.core.shards import ShardedDataset
from shaftpose.figures.drawing import (
    FOUND,
    TRUTH,
    contact_sheet,
    draw_annotations,
    draw_boxes,
    draw_caption,
    draw_detections,
    draw_masks,
    draw_poses,
    draw_real,
    draw_sample,
    evenly_spaced,
    pose_text,
    prediction_sheet,
)

CAMERA = Camera.from_field_of_view(299, 299, 95.0)
BLACK = np.zeros((299, 299, 3), dtype=np.uint8)
BOX = np.array([[150.0, 130.0, 299.0, 170.0]])
POSE = np.array([[0.0, 0.0, 20.0, 90.0, 0.0]])  # from the centre to the right


def drawn_at(image: np.ndarray) -> np.ndarray:
    """(N, 2) columns and rows of pixels that are not black."""
    rows, columns = np.nonzero(image.any(axis=2))
    return np.stack([columns, rows], axis=1)


def test_a_box_is_drawn_on_its_own_outermost_pixels() -> None:
    pixels = drawn_at(draw_boxes(BLACK, np.array([[10.0, 20.0, 31.0, 42.0]]), TRUTH))
    assert pixels.min(axis=0).tolist() == [10, 20]
    assert pixels.max(axis=0).tolist() == [30, 41]
    assert not BLACK.any()  # the input image is unchanged


def test_an_axis_runs_from_the_tip_towards_the_handle() -> None:
    # Pitch 90, yaw 0: straight to the right at constant depth; the tip projects to the centre.
    image = draw_poses(BLACK, np.array([[0.0, 0.0, 20.0, 90.0, 0.0]]), CAMERA, FOUND, text=False)
    pixels = drawn_at(image)
    assert pixels[:, 0].max() == 298
    assert np.abs(pixels[:, 1] - 149).max() <= 4  # the line and the circle of radius 3 at the tip
    assert pixels[:, 0].min() >= 149 - 5


def test_the_axis_of_a_shaft_that_passes_the_camera_keeps_its_direction() -> None:
    pose = np.array([-5.0, 5.0, 15.0, 50.0, 60.0])
    image = draw_poses(BLACK, pose[None], CAMERA, FOUND, text=False)
    direction = np.array([
        np.sin(np.radians(50)) * np.cos(np.radians(60)),
        np.sin(np.radians(50)) * np.sin(np.radians(60)),
        -np.cos(np.radians(50)),
    ])  # fmt: skip
    near = CAMERA.project(pose[:3] + 8.0 * direction)  # a point of the axis inside the image
    assert (np.abs(near - 149.5) < 149).all()
    assert np.abs(drawn_at(image) - near).sum(axis=1).min() <= 2


def test_an_axis_bends_where_the_lens_does() -> None:
    # Through (-0.75, 0.5), (0, 0.5) and (0.75, 0.5) at z = 1; f is 136.99 px. k1 and k2 scale the
    # radius of the first and the last, r^2 = 0.8125, by 0.8639, that of the middle by 0.9525.
    bent = replace(CAMERA, k1=-0.2, k2=0.04)
    pose = np.array([[-15.0, 10.0, 20.0, 90.0, 0.0]])
    pixels = drawn_at(draw_poses(BLACK, pose, bent, FOUND, text=False)) + 0.5
    for u, v in ((149.5, 214.74), (238.26, 208.67)):
        rows = pixels[np.abs(pixels[:, 0] - u) <= 0.5][:, 1]
        assert len(rows)
        assert np.abs(rows - v).max() <= 1.5
    assert np.hypot(*(pixels - [60.74, 208.67]).T).min() < 3.5  # the circle around the tip


def written_sample(folder: Path) -> Sample:
    """A shard with one grey image whose mask, box and axis do not overlap."""
    mask = np.zeros((299, 299), dtype=bool)
    mask[60:90, 80:140] = True
    mask[50:100, 100:102] = mask[84:86, 60:160] = True  # thin bars, so that the box is larger
    shaft = Instrument(ShaftPose.from_array(POSE[0]), mask, mask)
    rgb = np.full((299, 299, 3), 90, dtype=np.uint8)
    sample = Sample(sample_key(0), rgb, (shaft,), CAMERA, {})
    with ShardWriter(folder / shard_name(0), 95) as shard:
        shard.write(sample)
    return sample


def test_a_sample_is_drawn_with_all_that_is_known_of_it_and_nothing_else(tmp_path: Path) -> None:
    bare = written_sample(tmp_path).rgb
    drawn = draw_sample(ShardedDataset(tmp_path), sample_key(0))
    edges_of_the_box = (50, 70), (99, 120), (75, 60), (75, 159)  # row, column
    edges_of_the_mask = (60, 110), (89, 110), (75, 80), (75, 139)
    axis, circle = ((149, 200), (149, 298)), ((146, 149), (152, 149), (149, 146))
    for place in (*edges_of_the_box, *axis, *circle):
        np.testing.assert_allclose(drawn[place], TRUTH, atol=50, err_msg=str(place))
    for place in edges_of_the_mask:
        np.testing.assert_allclose(drawn[place], FOUND, atol=50, err_msg=str(place))
    differs = (drawn != bare).any(axis=-1)
    assert differs[280:299, 4:200].sum() > 300  # the pose in figures
    elsewhere = np.ones_like(differs)
    elsewhere[49:101, 59:161] = elsewhere[144:155, 144:] = elsewhere[278:] = False
    elsewhere[63:87, 83:137] = True  # inside the mask
    assert not differs[elsewhere].any()


def test_a_real_image_is_drawn_with_its_boxes_and_masks() -> None:
    mask = np.zeros((299, 299), dtype=bool)
    mask[140:160, 170:290] = True
    drawn = draw_real(BLACK, [mask], BOX)
    for place, colour in (((130, 200), TRUTH), ((140, 200), FOUND), ((150, 170), FOUND)):
        np.testing.assert_allclose(drawn[place], colour, atol=50, err_msg=str(place))
    assert not drawn[150, 200].any()


def test_a_mask_is_outlined_not_filled() -> None:
    mask = np.zeros((299, 299), dtype=bool)
    mask[100:120, 50:80] = True
    image = draw_masks(BLACK, [mask], TRUTH)
    assert image[100, 60].any()
    assert not image[110, 65].any()


def has(image: np.ndarray, colour: tuple[int, int, int]) -> bool:
    return bool((image == colour).all(axis=2).any())


def test_what_is_known_is_drawn_without_poses_where_they_are_unknown() -> None:
    boxes_only = draw_annotations(BLACK, Annotations(BOX, None), CAMERA)
    np.testing.assert_array_equal(boxes_only, draw_boxes(BLACK, BOX, TRUTH))
    with_pose = draw_annotations(BLACK, Annotations(BOX, POSE), CAMERA)
    assert with_pose[149, 200].any()  # on the axis
    assert with_pose[280:].any()  # the pose as text
    silent = draw_annotations(BLACK, Annotations(BOX, POSE), CAMERA, text=False)
    assert not silent[280:].any()


def test_a_prediction_sheet_shows_both_in_their_colours() -> None:
    nothing = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))
    found = Detections(BOX - 20, np.array([0.9]), POSE)
    known = Annotations(BOX, POSE)
    sheet = prediction_sheet([BLACK, BLACK], [known, known], [nothing, found], [CAMERA] * 2, 2)
    left, right = sheet[:, :299], sheet[:, 299:]
    assert has(left, TRUTH) and not has(left, FOUND)
    assert has(right, TRUTH) and has(right, FOUND)
    assert has(draw_detections(BLACK, found, CAMERA), FOUND)


def test_lines_of_text_do_not_overlap() -> None:
    grey = np.full((299, 299, 3), 128, dtype=np.uint8)
    poses = np.array([[-900.0, 12.4, 30.1, 88.0, 180.0]] * 3)  # out of view
    rows = (draw_poses(grey, poses, CAMERA, FOUND) != 128).any(axis=(1, 2))[200:]
    starts = np.count_nonzero(np.diff(rows.astype(int)) == 1)
    assert starts == 3
    assert rows.sum() > 30


def test_a_caption_stands_in_the_upper_left_corner() -> None:
    pixels = drawn_at(draw_caption(BLACK, "stand-in/clear"))
    assert pixels[:, 1].max() < 25
    assert pixels[:, 0].min() < 10
    assert not BLACK.any()


def test_a_sheet_is_filled_row_by_row() -> None:
    images = [np.full((2, 3, 3), value, dtype=np.uint8) for value in (1, 2, 3)]
    sheet = contact_sheet(images, columns=2)
    assert sheet.shape == (4, 6, 3)
    assert [int(sheet[r, c, 0]) for r, c in ((0, 0), (0, 3), (2, 0), (2, 3))] == [1, 2, 3, 0]


def test_pose_text() -> None:
    text = pose_text(np.array([1.04, -2.0, 30.06, 70.0, 358.0]))
    assert text == "x 1.0 y -2.0 z 30.1  p 70.0 w 358.0"


def test_items_are_spread_evenly_and_not_repeated() -> None:
    assert evenly_spaced(range(10), 4) == [0, 2, 5, 7]
    assert evenly_spaced("ab", 4) == ["a", "b"]
