from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.geometry import Disc, axis_direction
from shaftpose.core.instruments import Detections
from shaftpose.core.masks import mask_box
from shaftpose.refinement.contour import ARC, Contour
from shaftpose.refinement.edges import Offsets, mask_offsets
from shaftpose.refinement.fit import Fit
from shaftpose.refinement.refiner import FittedDetections, Refiner
from tests.core.silhouettes import CAMERA, POSES, SHAFT, soft_mask

OFF = np.array([0.5, -0.4, 1.5, 5.0, -4.0])
NEAR = np.array([0.05, 0.05, 0.3, 0.8, 0.3])


def detections(*poses: NDArray[np.float64]) -> Detections:
    return Detections(np.zeros((len(poses), 4)), np.ones(len(poses)), np.array(poses))


def grey(mask: NDArray[np.float32]) -> NDArray[np.uint8]:
    """A bright shaft on dark tissue."""
    return np.repeat((60 + 120 * mask).astype(np.uint8)[..., None], 3, axis=2)


def brightness_edges(rgb: NDArray[np.float32], contour: Contour, reach_px: float) -> Offsets:
    """Where such an image changes from bright to dark, as sure as an edge reader is of it."""
    soft = ((rgb[..., 0] + 1) * 127.5 - 60) / 120
    found = mask_offsets(soft, contour, min(reach_px, 2.0))
    return Offsets(found.px, 150 * found.weights)


EDGES = {"mask": None, "edges": brightness_edges}


@pytest.mark.parametrize("name", EDGES)
def test_poses_and_boxes_are_those_of_the_silhouette(name: str) -> None:
    mask = soft_mask(POSES[0])
    found = Refiner(SHAFT, EDGES[name])(grey(mask), mask, detections(POSES[0] + OFF), CAMERA)
    assert np.all(np.abs(found.poses[0] - POSES[0]) < NEAR)
    assert np.all(np.abs(found.boxes[0] - mask_box(mask > 0.5)) < 2.5)


def test_a_fit_that_leads_out_of_sight_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tip nearer to the camera than the shaft's radius and 1 mm has no contour, thus no box."""
    lost = Fit(np.array([0.0, 0.0, 2.0, 70.0, 0.0]), np.eye(5), CAMERA, 1.0)
    monkeypatch.setattr(Refiner, "_fits", lambda *_: [lost])
    mask = soft_mask(POSES[0])
    found = Refiner(SHAFT, None)(grey(mask), mask, detections(POSES[0]), CAMERA)
    np.testing.assert_array_equal(found.poses, POSES[:1])
    assert np.isnan(found.deviations).all()


def test_if_edges_lead_out_of_sight_the_fit_to_the_mask_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lost = Fit(np.array([0.0, 0.0, 2.0, 70.0, 0.0]), np.eye(5), CAMERA, 1.0)
    monkeypatch.setattr(Refiner, "_on_edges", lambda *_: lost)
    mask = soft_mask(POSES[0])
    both = [
        Refiner(SHAFT, edges)(grey(mask), mask, detections(POSES[0] + OFF), CAMERA)
        for edges in (None, EDGES["edges"])
    ]
    np.testing.assert_array_equal(both[1].poses, both[0].poses)
    np.testing.assert_array_equal(both[1].boxes, both[0].boxes)


def test_edges_of_the_image_correct_a_wrong_mask() -> None:
    true = POSES[0]
    wider = soft_mask(true + [0.0, 0.0, -0.8, 0.0, 0.0])
    refined = {
        name: Refiner(SHAFT, edges)(grey(soft_mask(true)), wider, detections(true + OFF), CAMERA)
        for name, edges in EDGES.items()
    }
    depth_errors = {name: abs(found.poses[0, 2] - true[2]) for name, found in refined.items()}
    assert depth_errors["edges"] < 0.3 < depth_errors["mask"]


def test_edges_of_a_finer_image_correct_a_wrong_mask() -> None:
    true = POSES[0]
    wider = soft_mask(true + [0.0, 0.0, -0.8, 0.0, 0.0])
    plain, fine = grey(np.zeros_like(wider)), grey(soft_mask(true, times=2))
    refiner, start = Refiner(SHAFT, brightness_edges), detections(true + OFF)
    coarse, finer = (refiner(plain, wider, start, CAMERA, image) for image in (None, fine))
    assert abs(finer.poses[0, 2] - true[2]) < 0.2 < abs(coarse.poses[0, 2] - true[2])
    assert np.all(np.abs(finer.poses[0] - true) < NEAR)
    assert np.all(finer.deviations < coarse.deviations)


def test_a_fit_to_the_mask_ignores_a_finer_image() -> None:
    mask = soft_mask(POSES[0])
    refiner, start = Refiner(SHAFT, None), detections(POSES[0] + OFF)
    fine = grey(soft_mask(POSES[1], times=2))
    found, expected = (
        refiner(grey(mask), mask, start, CAMERA, fine),
        refiner(grey(mask), mask, start, CAMERA),
    )
    np.testing.assert_array_equal(found.poses, expected.poses)


def test_two_shafts_are_fitted_apart() -> None:
    poses = POSES[0], np.array([-8.0, 5.0, 22.0, 65.0, 130.0])
    mask = np.maximum(*(soft_mask(pose) for pose in poses))
    starts = detections(*(pose + OFF for pose in poses))
    found = Refiner(SHAFT, None)(grey(mask), mask, starts, CAMERA)
    assert np.all(np.abs(found.poses - poses) < 2.5 * NEAR)


def test_a_smaller_mask_covers_the_same_view() -> None:
    mask = soft_mask(POSES[0])
    half = mask[:298, :298].reshape(149, 2, 149, 2).mean(axis=(1, 3))
    rgb = grey(mask)[:298, :298]
    found = Refiner(SHAFT, None)(rgb, half, detections(POSES[0] + OFF), CAMERA)
    assert np.all(np.abs(found.poses[0] - POSES[0]) < [0.1, 0.1, 0.5, 2.0, 0.5])


def test_a_hidden_part_has_no_say() -> None:
    mask, rgb = soft_mask(POSES[0]), grey(soft_mask(POSES[0]))
    mask[150:175] = 0.0  # across the shaft
    found = Refiner(SHAFT, None)(rgb, mask, detections(POSES[0] + 0.5 * OFF), CAMERA)
    assert np.all(np.abs(found.poses[0] - POSES[0]) < [0.1, 0.1, 0.4, 1.5, 0.5])


def test_a_detection_without_edges_stays_as_it_is() -> None:
    start = detections(POSES[0], np.array([0.0, 0.0, 20.0, np.nan, 0.0]))
    empty = np.zeros((299, 299), np.float32)
    found = Refiner(SHAFT, brightness_edges)(grey(empty), empty, start, CAMERA)
    assert np.array_equal(found.poses, start.poses, equal_nan=True)
    assert np.array_equal(found.boxes, start.boxes)


def test_an_image_without_detections() -> None:
    empty = np.zeros((299, 299), np.float32)
    none = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))
    assert len(Refiner(SHAFT, brightness_edges)(grey(empty), empty, none, CAMERA).scores) == 0


def test_fitted_poses_have_deviations() -> None:
    mask = soft_mask(POSES[0])
    start = detections(POSES[0] + OFF, np.array([0.0, 0.0, 20.0, np.nan, 0.0]))
    found = Refiner(SHAFT, None)(grey(mask), mask, start, CAMERA)
    assert np.all(found.deviations[0] > 0)
    assert np.all(found.deviations[0] < [0.5, 0.5, 2.0, 10.0, 3.0])
    assert np.isnan(found.deviations[1]).all()
    assert len(found.above(2.0).deviations) == 0


def test_boxes_end_at_the_border() -> None:
    mask = soft_mask(POSES[1])
    found = Refiner(SHAFT, None)(grey(mask), mask, detections(POSES[1] + 0.5 * OFF), CAMERA)
    assert np.all(np.abs(found.boxes[0] - mask_box(mask > 0.5)) < 1)
    # One of its lines is not in the image, nor is its tip.
    along_border = np.array([21.0, -30.0, 20.0, 88.0, 88.0])
    mask = soft_mask(along_border)
    found = Refiner(SHAFT, None)(grey(mask), mask, detections(along_border), CAMERA)
    assert np.all(np.abs(found.boxes[0] - mask_box(mask > 0.5)) < 8)
    assert found.boxes[0, 1:3].tolist() == [0, CAMERA.width]


def test_a_shaft_without_a_flat_tip_keeps_its_box() -> None:
    mask, box = soft_mask(POSES[0]), np.array([[1.0, 2.0, 3.0, 4.0]])
    start = Detections(box, np.ones(1), POSES[0][None] + OFF)
    found = Refiner(SHAFT._replace(flat_tip=False), None)(grey(mask), mask, start, CAMERA)
    assert np.array_equal(found.boxes, box)
    assert np.all(np.abs(found.poses[0, 3:] - POSES[0][3:]) < 1)
    assert found.tips[0] == "seen"  # though no arc shows it


def with_sure_edges(sure_of_tip: bool) -> FittedDetections:
    """A fit to edges of which a reader is sure, except perhaps on the tip's arc."""

    def edges(rgb: NDArray[np.float32], contour: Contour, reach_px: float) -> Offsets:
        found = brightness_edges(rgb, contour, reach_px)
        unsure = (contour.parts == ARC) & (not sure_of_tip)
        return Offsets(found.px, np.where(unsure, 0.1, 1.0) * found.weights)

    mask = soft_mask(POSES[0])
    return Refiner(SHAFT, edges)(grey(mask), mask, detections(POSES[0] + 0.2 * OFF), CAMERA)


def test_a_tip_without_a_sure_arc_is_hidden_and_may_lie_elsewhere_on_the_axis() -> None:
    seen, hidden = with_sure_edges(sure_of_tip=True), with_sure_edges(sure_of_tip=False)
    assert (seen.tips[0], hidden.tips[0]) == ("seen", "hidden")
    assert (seen.deviations[0, :3] < 0.5).all()
    grown = np.sqrt(hidden.deviations[0, :3] ** 2 - seen.deviations[0, :3] ** 2)
    along_mm = 70 * POSES[0][2] / CAMERA.focal_px * axis_direction(*POSES[0][3:])
    np.testing.assert_allclose(grown, np.abs(along_mm), rtol=0.1)
    np.testing.assert_allclose(hidden.deviations[0, 3:], seen.deviations[0, 3:], rtol=0.5)


@pytest.mark.parametrize("times", [1, 3])
def test_a_tip_is_as_clear_in_an_enlarged_image(times: int) -> None:
    """Its blurred arc has the same information as a whole, thus less per px."""

    def edges(rgb: NDArray[np.float32], contour: Contour, reach_px: float) -> Offsets:
        found = brightness_edges(rgb, contour, reach_px)
        return Offsets(found.px, found.weights * (CAMERA.width / rgb.shape[1]) ** 2)

    mask = soft_mask(POSES[0])
    rgb = grey(mask)
    fine = np.repeat(np.repeat(rgb, times, axis=0), times, axis=1)
    start = detections(POSES[0] + 0.2 * OFF)
    assert Refiner(SHAFT, edges)(rgb, mask, start, CAMERA, fine).tips[0] == "seen"


def test_errors_of_as_many_samples_in_finer_pixels_are_finer_alike() -> None:
    """The outline has as many samples in nine pixels for one: of the same error in pixels, they
    give a third of it in mm."""

    def edges(rgb: NDArray[np.float32], contour: Contour, reach_px: float) -> Offsets:
        found = brightness_edges(rgb, contour, reach_px)
        return Offsets(found.px, 1e4 * found.weights)  # so that the mask tells nothing besides

    mask = soft_mask(POSES[0])
    refiner, start = Refiner(SHAFT, edges), detections(POSES[0])
    fine = grey(soft_mask(POSES[0], times=3))
    coarse, finer = (refiner(grey(mask), mask, start, CAMERA, one) for one in (None, fine))
    np.testing.assert_allclose(finer.deviations, coarse.deviations / 3, rtol=0.1)


def test_a_tip_beyond_the_border_is_outside() -> None:
    pose = np.array([-27.0, 0.0, 20.0, 80.0, 0.0])  # its tip at -35 px, its body in the image
    mask = soft_mask(pose)
    found = Refiner(SHAFT, None)(grey(mask), mask, detections(pose), CAMERA)
    assert found.tips[0] == "outside"
    assert found.deviations[0, 0] > 5
    # The same for the border of a round field.
    narrow = replace(CAMERA, field=Disc(200.0, 149.5, 120.0))
    within = Refiner(SHAFT, None)(grey(mask), mask, detections(POSES[0]), narrow)
    assert within.tips[0] == "outside"


def test_a_wrong_pitch_is_found_from_one_of_several_starts() -> None:
    """The network's pitch is 40 deg off, and its prior pulls back there."""
    pose = np.array([-5.0, 3.0, 15.0, 50.0, 200.0])
    mask, wrong = soft_mask(pose), detections(pose + [0, 0, 0, 38.0, 0])
    alone = Refiner(SHAFT, None)(grey(mask), mask, wrong, CAMERA)
    several = Refiner(SHAFT, None, (45.0, 90.0))(grey(mask), mask, wrong, CAMERA)
    errors = [abs(found.poses[0, 3] - 50) for found in (alone, several)]
    assert errors[1] < 0.7 * errors[0]


def test_a_wide_shaft_is_found_on_its_run_where_the_network_is_far_off() -> None:
    """One side of the network's shaft meets an edge, the other lies out of reach."""
    pose = np.array([0.5, 0.5, 7.0, 50.0, 190.0])  # 60 px wide at the tip
    mask, wrong = soft_mask(pose), detections(pose + [0.2, 0.5, 2.0, 15.0, -20.0])
    found = Refiner(SHAFT, None, (40.0, 90.0))(grey(mask), mask, wrong, CAMERA)
    assert found.poses[0] == pytest.approx(pose, abs=1.5)


def test_pitches_have_bounds_by_the_range_of_the_training() -> None:
    end_on = np.array([0.0, 0.0, 30.0, 12.0, 0.0])
    for turned, low, kept, within in ((POSES[2], 50, 90, 3), (end_on, 60, 15, 0.1)):
        mask = soft_mask(turned)
        found = Refiner(SHAFT, None, (low, 90.0))(grey(mask), mask, detections(turned), CAMERA)
        assert found.poses[0, 3] == pytest.approx(kept, abs=within)
