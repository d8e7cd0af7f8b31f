"""Rules of which detections show which true shafts, by hand.

One px is 0.2 mm at a depth of 30 mm; 15 px of an image of 299 px are 15.05 px.
"""

from dataclasses import replace

import numpy as np

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Array, Camera, Disc, ShaftPose
from shaftpose.inference.found_shafts import FoundShaft, axis_points
from shaftpose.refinement.contour import Shaft
from shaftpose.refinement.refiner import TipState
from studies.whole_frames.frames import AnnotatedFrame
from studies.whole_frames.matching import Detection, TrueShaft, compared

CAMERA = Camera(300, 300, 150.0, 150.0, 150.0)
ROD = Shaft(3.0, 150.0)
# From the image's centre to its right border, 15 px wide.
RIGHT = np.array([0.0, 0, 30, 90, 0])
# From the right border, beyond the left one, to the right: the whole width.
ACROSS = np.array([-40.0, 10, 30, 90, 0])


def moved(pose: Array, x_mm: float = 0, y_mm: float = 0, yaw_deg: float = 0) -> Array:
    return pose + np.array([x_mm, y_mm, 0, 0, yaw_deg])


def frame(*poses: Array, camera: Camera = CAMERA) -> AnnotatedFrame:
    """Shafts that nothing hides, without an image."""
    size = ROD.diameter_mm, ROD.length_mm
    depths = [cylinder_depth(camera, ShaftPose.from_array(pose), *size) for pose in poses]
    masks = np.isfinite(np.reshape(depths, (-1, camera.height, camera.width)))
    rgb = np.zeros((camera.height, camera.width, 3), np.uint8)
    return AnnotatedFrame(rgb, camera, np.reshape(poses, (-1, 5)), masks)


def hiding(whole: AnnotatedFrame, hidden: slice) -> AnnotatedFrame:
    """The same with hidden columns."""
    masks = whole.masks.copy()
    masks[:, :, hidden] = False
    return replace(whole, masks=masks)


def found(pose: Array, tip: TipState = "seen", camera: Camera = CAMERA) -> FoundShaft:
    shaft = ShaftPose.from_array(pose)
    return FoundShaft(0.9, np.zeros(4), camera.project(axis_points(shaft)), shaft, True, tip)


def compare(true: AnnotatedFrame, *those: FoundShaft) -> tuple[list[TrueShaft], list[Detection]]:
    return compared(true, those, true.camera, ROD, ROD)


def false_ones(true: AnnotatedFrame, *those: FoundShaft) -> list[bool]:
    return [one.is_false for one in compare(true, *those)[1]]


def test_a_tip_is_found_within_15_px() -> None:
    near, far = found(moved(RIGHT, y_mm=3.0)), found(moved(RIGHT, y_mm=3.02))
    (shaft,), (detection,) = compare(frame(RIGHT), near)
    assert shaft.found is near
    assert not detection.is_false
    (shaft,), (detection,) = compare(frame(RIGHT), far)
    assert shaft.found is None
    assert detection.is_false


def test_the_nearest_of_two_detections_finds_a_tip() -> None:
    (shaft,), detections = compare(
        frame(RIGHT), found(moved(RIGHT, x_mm=2)), found(moved(RIGHT, x_mm=1))
    )
    assert shaft.found is detections[1].found
    assert [one.is_false for one in detections] == [True, False]


def test_each_of_two_shafts_has_its_own_detection() -> None:
    first, second = moved(RIGHT, y_mm=-2), moved(RIGHT, y_mm=2)
    shafts, detections = compare(frame(first, second), found(second), found(moved(first, y_mm=1)))
    assert [shaft.found and shaft.found.pose.y_mm for shaft in shafts] == [-1, 2]
    assert not any(one.is_false for one in detections)


def test_a_shaft_with_the_tip_outside_is_found_along_itself_once() -> None:
    once = found(moved(ACROSS, x_mm=5), "outside")
    (shaft,), (detection,) = compare(frame(ACROSS), once)
    assert shaft.tip == "outside"
    assert shaft.found is once
    assert not detection.is_false
    assert false_ones(frame(ACROSS), once, once) == [False, True]
    assert false_ones(frame(ACROSS), found(moved(ACROSS, y_mm=4), "outside")) == [True]
    assert false_ones(frame(ACROSS), found(moved(RIGHT, y_mm=10, yaw_deg=90), "hidden")) == [True]


def test_a_tip_that_is_called_seen_where_none_is_seen_is_false() -> None:
    (shaft,), (detection,) = compare(frame(ACROSS), found(moved(ACROSS, x_mm=12)))
    assert shaft.found is detection.found
    assert detection.is_false
    assert detection.at_edge  # its tip is at -40 + 12 = -28 mm: 10 px from the border
    (_, (inside,)) = compare(frame(ACROSS), found(moved(ACROSS, x_mm=20)))
    assert inside.is_false
    assert not inside.at_edge


def test_a_detection_elsewhere_on_a_shaft_whose_tip_is_seen_is_false() -> None:
    assert false_ones(frame(RIGHT), found(moved(RIGHT, x_mm=10), "hidden")) == [True]


def test_a_tip_is_hidden_if_nine_tenths_around_it_are() -> None:
    # Half a disc of 7.5 px: columns 150 to 157. Without the last one, and without the last three.
    whole = frame(RIGHT)
    (shaft,), (detection,) = compare(
        hiding(whole, slice(150, 157)), found(moved(RIGHT, x_mm=10), "hidden")
    )
    assert shaft.tip == "hidden"
    assert shaft.found is detection.found
    assert not detection.is_false
    (shaft,), _ = compare(hiding(whole, slice(150, 154)))
    assert shaft.tip == "seen"


def test_a_shaft_with_fewer_than_400_px_in_an_image_of_299_px_does_not_count() -> None:
    # In one of 300 px, these are 402.7 px.
    for shown, counts in ((402, False), (403, True)):
        part = frame(RIGHT)
        part.masks.flat[np.flatnonzero(part.masks)[shown:]] = False
        (shaft,), _ = compare(part)
        assert shaft.counts == counts


def test_tips_beside_the_central_square_and_crossed_shafts_are_known() -> None:
    camera = Camera(500, 300, 150.0, 250.0, 150.0)
    tips = [
        moved(RIGHT, x_mm=-31),
        moved(RIGHT, x_mm=-29, y_mm=5),
        moved(RIGHT, x_mm=5, yaw_deg=90),
    ]
    shafts, detections = compare(frame(*tips, camera=camera))
    assert [shaft.beside for shaft in shafts] == [True, False, False]
    # The third shaft points down from the first one's axis, through the second one.
    assert [shaft.crossed for shaft in shafts] == [True, True, True]
    assert detections == []
    apart, _ = compare(frame(*tips[:2], camera=camera))
    assert [shaft.crossed for shaft in apart] == [False, False]


def test_a_tip_outside_of_a_round_picture_is_outside() -> None:
    camera = replace(CAMERA, field=Disc(150.0, 150.0, 200.0))
    edge, centre = compare(frame(moved(RIGHT, x_mm=-21), RIGHT, camera=camera))[0]
    assert (edge.tip, centre.tip) == ("outside", "seen")
    # In the disc, the whole of a detection without a disc of its own lies on its shaft.
    small = replace(CAMERA, field=Disc(150.0, 200.0, 60.0))
    across = found(ACROSS, "outside")
    (shaft,), _ = compared(frame(ACROSS, camera=small), [across], CAMERA, ROD, ROD)
    assert shaft.found is across


def test_a_frame_without_shafts_is_compared() -> None:
    assert compare(frame()) == ([], [])
    assert false_ones(frame(), found(RIGHT)) == [True]
