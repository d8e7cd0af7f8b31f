"""E's targets, loss and decoding on synthetic shafts."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn import functional

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose, pose_along
from shaftpose.core.instruments import OUTSIDE, TOOL, TOOL_OR_SHAFT, UNKNOWN
from shaftpose.core.masks import mask_box
from shaftpose.dataset.batches import Targets
from shaftpose.network.dense.coding import Grid, axis_vectors, decoded_poses, encoded_axis
from shaftpose.network.dense.decoding import decode
from shaftpose.network.dense.loss import dense_targets, shaft_masks, tool_masks
from shaftpose.network.dense.network import DenseNetwork
from shaftpose.refinement.contour import Shaft
from tests.network.tiny import E_LOSS, LIMITS

SIDE, CELLS, DIAMETER_MM, LENGTH_MM = 299, 75, 3.0, 150.0
CAMERA = Camera.from_field_of_view(SIDE, SIDE, 95.0)
GRID, FINE = (
    Grid.over(torch.empty(SIDE, SIDE), cells, cells, CAMERA.focal_px) for cells in (CELLS, 150)
)
POSES = [[-6.0, 4.0, 20.0, 70.0, 130.0], [7.0, -2.0, 25.0, 80.0, 300.0]]


def mask_of(pose: list[float]) -> np.ndarray:
    shaft = ShaftPose.from_array(np.array(pose))
    return np.isfinite(cylinder_depth(CAMERA, shaft, DIAMETER_MM, LENGTH_MM))


def targets_of(poses: list[list[float]]) -> Targets:
    """One image of these shafts; the second image of the batch has unknown masks and no poses."""
    masks = [mask_of(pose) for pose in poses]
    instances = np.stack([np.zeros((SIDE, SIDE)), np.full((SIDE, SIDE), UNKNOWN)]).astype(np.uint8)
    for number, mask in enumerate(masks, 1):
        instances[0][mask & (instances[0] == 0)] = number
    boxes = torch.tensor([mask_box(mask) for mask in masks]).float() / SIDE
    return Targets(
        boxes=torch.stack([boxes, boxes]),
        poses=torch.tensor([poses, poses]),
        valid=torch.ones(2, len(poses), dtype=torch.bool),
        has_pose=torch.tensor([True, False]),
        instances=torch.from_numpy(instances),
        cameras=torch.tensor([[CAMERA.focal_px, CAMERA.cx, CAMERA.cy]] * 2),
    )


def perfect_outputs(targets: Targets) -> tuple[Tensor, Tensor]:
    """The mask and the maps of a network that knows the targets."""
    truth = dense_targets(targets, GRID)
    known = truth.values * truth.counts
    maps = torch.cat([torch.logit(truth.heat, eps=1e-6)[:, None], known], dim=1)
    assert targets.instances is not None
    mask = 20 * (targets.instances[:, None, ::2, ::2] > 0).float() - 10
    return mask, maps


def loss_terms(mask: Tensor, maps: Tensor, targets: Targets) -> dict[str, Tensor]:
    """The loss of outputs whose two masks are the same."""
    return E_LOSS(mask.expand(-1, 2, -1, -1), maps, targets, GRID)


def test_tensors_are_projected_as_by_the_camera() -> None:
    points = torch.tensor([[1.0, -2.0, 20.0], [5.0, 3.0, 11.0]])
    camera = Camera(400, 250, 130.0, 200.0, 125.0)
    grid = Grid.over(torch.empty(250, 400), 5, 8, camera.focal_px)
    pixels = grid.project(points)
    np.testing.assert_allclose(pixels.numpy(), camera.project(points.double().numpy()), rtol=1e-5)
    torch.testing.assert_close(grid.lift(pixels, points[:, 2:]), points)
    assert grid.cells[0, 0].tolist() == [25, 25] and grid.cells[4, 7].tolist() == [375, 225]


def test_poses_survive_their_coding() -> None:
    poses = torch.tensor(POSES)
    tips = GRID.project(poses[:, :3])
    values = torch.cat(
        [2 * torch.log(poses[:, 2:3] / 25), encoded_axis(axis_vectors(poses))], dim=-1
    )
    torch.testing.assert_close(decoded_poses(tips, values, GRID), poses, rtol=1e-4, atol=1e-3)


def test_targets_by_hand() -> None:
    heat, heat_known, values, counts = dense_targets(targets_of(POSES[:1]), GRID)
    on_shaft = counts.all(1)
    u, v = 136.99 * -6 / 20 + 149.5, 136.99 * 4 / 20 + 149.5
    row, column = int(v / SIDE * CELLS), int(u / SIDE * CELLS)
    assert heat[0].flatten().argmax() == row * CELLS + column
    assert on_shaft[0, row, column + 0] or on_shaft[0, row + 1, column]
    cell = on_shaft[0].nonzero()[3]
    x, y = ((cell.flip(0) + 0.5) * SIDE / CELLS).tolist()
    shown = values[0, :, cell[0], cell[1]].tolist()
    offset = (u - x) / 50, (v - y) / 50
    p, w = np.radians(70), np.radians(130)
    axis = [np.sin(p) * np.cos(w), np.sin(p) * np.sin(w), -2 * np.cos(p)]
    assert shown == pytest.approx([*offset, 2 * np.log(20 / 25), *axis], abs=1e-3)
    assert heat_known[0].all() and not heat_known[1].any()
    assert not heat[1].any() and not counts[1].any()  # the image without poses


def test_annotated_tips_give_heat_and_offsets_without_poses() -> None:
    targets = targets_of(POSES)
    assert targets.instances is not None
    tips = GRID.project(targets.poses[..., :3])
    shown = targets._replace(instances=targets.instances[[0, 0]], tips_px=tips)
    truth = dense_targets(shown, GRID)
    assert truth.heat_known.all()
    torch.testing.assert_close(truth.heat[1], truth.heat[0])
    torch.testing.assert_close(truth.values[1, :2], truth.values[0, :2])
    assert torch.equal(truth.counts[1, :2], truth.counts[0, :2])
    assert not truth.counts[1, 2:].any()  # depth and axis
    # One unknown tip: next to its shaft, no heat is known; offsets point to the other alone.
    tips = tips.clone()
    tips[1, 0] = torch.nan
    truth = dense_targets(shown._replace(tips_px=tips), GRID)
    at = ((torch.arange(CELLS) + 0.5) * SIDE / CELLS).long()
    first, second = (targets.instances[0][at][:, at] == number for number in (1, 2))
    assert not truth.counts[1, 0][first].any() and truth.counts[1, 0][second].all()
    assert truth.heat_known[0].all() and not truth.heat_known[1][first].any()
    assert 0.7 < truth.heat_known[1].float().mean() < 1
    assert truth.values.isfinite().all()


def test_next_to_unknown_pixels_no_heat_is_known() -> None:
    targets = targets_of(POSES)
    instances = torch.zeros(2, SIDE, SIDE, dtype=torch.uint8)
    instances[0, 150:154, 150:154], instances[1, 150:154, 150:154] = UNKNOWN, TOOL_OR_SHAFT
    empty = targets._replace(valid=torch.zeros_like(targets.valid), instances=instances)
    known = dense_targets(empty, GRID).heat_known
    row = column = 152 * CELLS // SIDE  # the only cell whose centre, 151.5 px, is unknown
    expected = torch.ones(2, CELLS, CELLS, dtype=torch.bool)
    expected[:, row - 2 : row + 3, column - 2 : column + 3] = False
    assert torch.equal(known, expected)


def test_a_tip_outside_the_visible_field_has_no_heat() -> None:
    targets = targets_of(POSES)
    assert targets.instances is not None
    tip = GRID.project(targets.poses[0, 0, :3]).long().tolist()
    instances = targets.instances.clone()
    instances[0, tip[1] - 4 : tip[1] + 4, tip[0] - 4 : tip[0] + 4] = OUTSIDE
    whole, cut = (
        dense_targets(targets._replace(instances=each), GRID)
        for each in (targets.instances, instances)
    )
    row, column = tip[1] * CELLS // SIDE, tip[0] * CELLS // SIDE
    assert whole.heat[0, row, column] > 0.9 and cut.heat[0, row, column] < 0.1
    assert cut.heat[0].max() > 0.9  # the other shaft's


def test_another_camera_of_the_same_image_has_the_same_targets() -> None:
    """A camera of twice the focal length, whose axis meets another pixel, sees in every direction
    what the reference camera sees of a scene that is sheared and half as deep."""
    targets = targets_of(POSES)
    aside, focal_px = np.array([20.0, -10.0]), 2 * CAMERA.focal_px
    moved = np.array(POSES)
    linear = np.array([[1, 0, -aside[0] / CAMERA.focal_px], [0, 1, -aside[1] / CAMERA.focal_px]])
    linear = np.vstack([linear, [0, 0, 2]])
    for row, pose in enumerate(POSES):
        shaft = ShaftPose.from_array(np.array(pose))
        axis = linear @ shaft.direction
        moved[row] = pose_along(axis / np.linalg.norm(axis), linear @ shaft.tip_mm).as_array()
    cameras = torch.tensor([[focal_px, *(SIDE / 2 + aside)]] * 2).float()
    same = targets._replace(poses=torch.tensor(np.stack([moved] * 2)).float(), cameras=cameras)
    one, other = dense_targets(targets, GRID), dense_targets(same, GRID)
    torch.testing.assert_close(one.heat, other.heat, rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(
        one.values * one.counts, other.values * other.counts, atol=1e-3, rtol=1e-3
    )


def test_masks_of_shafts_and_of_tools_by_hand() -> None:
    instances = torch.tensor([[[0, 1, 2, OUTSIDE, TOOL, TOOL_OR_SHAFT, UNKNOWN]]]).byte()
    inside, known = shaft_masks(instances)
    assert inside.flatten()[known.flatten()].tolist() == [False, True, True, False, False]
    assert known.flatten().tolist() == [True] * 5 + [False] * 2
    inside, known = tool_masks(instances)
    assert inside.flatten()[known.flatten()].tolist() == [False, True, True, False, True, True]
    assert known.flatten().tolist() == [True] * 6 + [False]


def test_perfect_outputs_are_decoded_to_the_poses_and_boxes() -> None:
    targets = targets_of(POSES)
    found = decode(*perfect_outputs(targets), FINE, GRID, LIMITS)
    scores = found.scores[0]
    assert (scores > 0.5).sum() == 2
    order = found.poses[0, :2, 0].argsort()
    np.testing.assert_allclose(found.poses[0, order], POSES, atol=0.25)
    boxes = targets.boxes[0] * SIDE
    # Next to a shaft these maps are 0, and offsets at the mask's resolution are interpolated.
    np.testing.assert_allclose(found.boxes[0, order], boxes, atol=5)
    assert not (found.scores[1] > 0.5).any()


def test_a_wider_image_shows_the_same_shafts_about_its_own_centre() -> None:
    mask, maps = perfect_outputs(targets_of(POSES))
    # As much background on the left: the same shafts in an image twice as wide.
    shifted = [
        functional.pad(maps, (CELLS, 0), value=-14.0),
        functional.pad(mask, (150, 0), value=-10.0),
    ]
    shifted[0][:, 1:, :, :CELLS] = 0
    wide = torch.empty(SIDE, 2 * SIDE)
    grids = [Grid.over(wide, *one.shape[-2:], CAMERA.focal_px) for one in reversed(shifted)]
    found, narrow = (
        decode(*outputs, LIMITS)
        for outputs in ((*reversed(shifted), *grids), (mask, maps, FINE, GRID))
    )
    assert (found.scores[0] > 0.5).sum() == 2
    depths = narrow.poses[0, :2, 2:3]
    moved = GRID.project(narrow.poses[0, :2, :3])[:, 0] + SIDE
    np.testing.assert_allclose(grids[1].project(found.poses[0, :2, :3])[:, 0], moved, atol=0.3)
    np.testing.assert_allclose(found.poses[0, :2, 2:3], depths, rtol=1e-3)


def test_fewer_places_keep_the_best() -> None:
    outputs = perfect_outputs(targets_of(POSES))
    limits = replace(LIMITS, max_detections=1)
    assert decode(*outputs, FINE, GRID, limits).poses.shape == (2, 1, 5)


def test_pixels_between_two_tips_belong_to_the_shaft_along_whose_axis_they_lie() -> None:
    # Tips 14 px apart, axes to the left and down; far pixels of the first vote for the second tip.
    targets = targets_of([[-1.0, 0.0, 20.0, 80.0, 180.0], [1.0, 0.0, 20.0, 80.0, 90.0]])
    mask, maps = perfect_outputs(targets)
    maps[0, 1, :, : CELLS // 2 - 10] += 9 / 50
    found = decode(mask, maps, FINE, GRID, LIMITS)
    order = found.poses[0, :2, 0].argsort()
    np.testing.assert_allclose(found.boxes[0, order], targets.boxes[0] * SIDE, atol=6)


def test_perfect_outputs_have_next_to_no_loss() -> None:
    targets = targets_of(POSES)
    terms = loss_terms(*perfect_outputs(targets), targets)
    assert terms["pose"] == 0
    assert terms["tip"] < 0.1  # next to the peak the truth is neither 0 nor 1
    assert terms["mask"] < 0.5  # half the resolution blurs the border
    assert terms["loss"] == pytest.approx(sum(float(v) for k, v in terms.items() if k != "loss"))


def test_an_image_without_masks_and_poses_gives_no_gradient() -> None:
    targets = targets_of(POSES)
    mask, maps = (value.clone().requires_grad_() for value in perfect_outputs(targets))
    loss_terms(mask + 0.1, maps + 0.1, targets)["loss"].backward()
    assert mask.grad is not None and maps.grad is not None
    assert mask.grad[0].any() and maps.grad[0].any()
    assert not mask.grad[1].any() and not maps.grad[1].any()


def test_an_image_without_poses_teaches_its_masks_and_where_no_tips_are() -> None:
    targets = targets_of(POSES)
    assert targets.instances is not None
    mask, maps = (value.clone().requires_grad_() for value in perfect_outputs(targets))
    known = targets.instances[[0, 0]]
    known[1, :, :50] = UNKNOWN
    loss_terms(mask, maps, targets._replace(instances=known))["loss"].backward()
    assert mask.grad is not None and maps.grad is not None
    assert mask.grad[1].any() and not maps.grad[1, 1:].any()
    assert maps.grad[1, 0].any() and not maps.grad[1, 0, :, :14].any()  # to 50 px, and near
    assert not mask.grad[1, :, :, :24].any()  # half the resolution


def test_the_border_weighs_ten_times_as_much() -> None:
    truth = torch.zeros(1, 41, 41)
    truth[:, :, :20] = 1
    weight = E_LOSS.border_weight(truth)[0, 20]
    assert weight[19] == weight[20] == 10
    assert weight[22] == pytest.approx(1 + 9 * np.exp(-2 / 2.5))
    assert weight[0] == weight[-1] == 1


def test_the_network_learns_one_image_by_heart() -> None:
    torch.manual_seed(0)
    network = DenseNetwork((8, 8, 8, 16), CAMERA, Shaft(DIAMETER_MM, LENGTH_MM), E_LOSS)
    targets = targets_of(POSES)
    assert targets.instances is not None
    image = (targets.instances[:, None] > 0).float().expand(-1, 3, -1, -1) * 2 - 1
    optimizer = torch.optim.Adam(network.parameters(), lr=0.01)
    losses = []
    for _ in range(12):
        terms = network.loss_terms(network(image), targets)
        optimizer.zero_grad()
        terms["loss"].backward()
        optimizer.step()
        losses.append(float(terms["loss"].detach()))
    assert losses[-1] < 0.6 * losses[0]
