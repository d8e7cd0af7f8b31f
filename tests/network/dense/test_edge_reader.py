"""Training samples of the edge reader, and what it learns from them."""

import numpy as np
import torch

from shaftpose.dataset.batches import Targets
from shaftpose.network.dense.edge_reader import (
    EdgeReader,
    covered,
    edge_samples,
    true_offsets,
)
from shaftpose.refinement.contour import Shaft, shaft_contour
from shaftpose.refinement.contour_sampling import COLUMNS, MIDDLE, ROWS
from shaftpose.refinement.pose_parameters import moved
from tests.core.silhouettes import CAMERA, POSES, SHAFT, SIDE_PX, fine_mask, soft_mask


def batch(poses: list[np.ndarray]) -> tuple[torch.Tensor, Targets]:
    """An image for each pose, white shafts on black, and the targets."""
    masks = torch.from_numpy(np.stack([soft_mask(pose) for pose in poses]))
    images = (2 * masks - 1)[:, None].expand(-1, 3, -1, -1)
    count = len(poses)
    return images, Targets(
        boxes=torch.zeros(count, 1, 4),
        poses=torch.tensor(np.stack(poses))[:, None].float(),
        valid=torch.ones(count, 1, dtype=torch.bool),
        has_pose=torch.ones(count, dtype=torch.bool),
        instances=(masks > 0.5).byte(),
        cameras=torch.tensor([[CAMERA.focal_px, CAMERA.cx, CAMERA.cy]] * count),
    )


def test_covered_pixels_are_those_whose_rays_meet_the_cylinder() -> None:
    centres = np.moveaxis(np.mgrid[:SIDE_PX, :SIDE_PX][::-1] + 0.5, 0, -1)
    for pose in POSES:
        np.testing.assert_array_equal(covered(centres, pose, SHAFT, CAMERA), fine_mask(pose, 1))


def test_offsets_lead_to_the_true_outline() -> None:
    """Against the motion of the contour, which a small step of the pose follows."""
    for pose in POSES:
        step = np.array([0.3, -0.2, 0.01, 0.5, -0.4])
        contour = shaft_contour(moved(pose, step, CAMERA), SHAFT, CAMERA)
        offsets = true_offsets(contour, pose, SHAFT, CAMERA, reach_px=3.0)
        there = moved(pose, step, CAMERA)
        predicted = contour.motion @ (pose - there)
        assert (np.abs(offsets) < 3.0).mean() > 0.9
        assert np.median(np.abs(offsets - predicted)) < 0.03


def test_offsets_end_at_the_reach() -> None:
    contour = shaft_contour(POSES[0] + [2.0, 2.0, 0.0, 0.0, 0.0], SHAFT, CAMERA)
    near, far = (true_offsets(contour, POSES[0], SHAFT, CAMERA, px) for px in (2.0, 30.0))
    assert 0.5 < (np.abs(far) > 2.0).mean() < 1
    np.testing.assert_allclose(near, np.clip(far, -2.0, 2.0), atol=0.05)


def test_the_opposite_edge_of_a_thin_shaft_is_not_taken_for_the_outline() -> None:
    thin = Shaft(diameter_mm=1.0)  # 6.8 px wide
    pose = np.array([0.0, 0.0, 20.0, 90.0, 0.0])
    contour = shaft_contour(pose + [0.0, 0.3, 0.0, 0.0, 0.0], thin, CAMERA)
    offsets = true_offsets(contour, pose, thin, CAMERA, reach_px=10.0)
    line = contour.parts < 2
    expected = -0.3 * contour.normals[line, 1] * CAMERA.focal_px / 20
    np.testing.assert_allclose(offsets[line], expected, atol=0.1)


def test_in_the_samples_the_step_from_white_to_black_is_at_the_offset() -> None:
    torch.manual_seed(1)
    samples = edge_samples(*batch([POSES[0], POSES[1]]), SHAFT)
    assert samples.colours.shape[1:] == (3, ROWS, COLUMNS)
    white = samples.colours[:, 0].clamp(-1, 1) > 0
    steps = white.sum(-1) - MIDDLE - 0.5
    # Rows whose innermost columns lie beyond the opposite edge of a thin shaft begin black.
    near = samples.offsets.abs() < MIDDLE - 2.1
    clear = samples.known & near & white[..., 0]
    assert clear.float().mean() > 0.4
    assert (steps - samples.offsets)[clear].abs().median() < 0.5
    assert samples.offsets.abs().max() <= MIDDLE - 2


def test_images_without_poses_have_no_samples() -> None:
    images, targets = batch([POSES[0]])
    unknown = targets._replace(has_pose=torch.zeros(1, dtype=torch.bool))
    samples = edge_samples(images, unknown, SHAFT)
    assert len(samples.colours) == 0
    assert EdgeReader().loss(samples).item() == 0


def test_samples_depend_on_torchs_seed_alone() -> None:
    images, targets = batch([POSES[0]])
    drawn = []
    for seed in (3, 3, 4):
        torch.manual_seed(seed)
        drawn.append(edge_samples(images, targets, SHAFT).offsets)
    assert torch.equal(drawn[0], drawn[1])
    assert drawn[0].shape != drawn[2].shape or not torch.equal(drawn[0], drawn[2])


def test_the_reader_learns_where_an_outline_is() -> None:
    torch.manual_seed(0)
    reader, (images, targets) = EdgeReader(), batch(list(POSES[:3]))
    optimizer = torch.optim.Adam(reader.parameters(), lr=3e-3)
    for _ in range(40):
        loss = reader.loss(edge_samples(images, targets, SHAFT))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    samples = edge_samples(images, targets, SHAFT)
    offsets, _ = reader(samples.colours)
    errors = (offsets - samples.offsets).abs()[samples.known]
    assert errors.median() < 0.5 * samples.offsets.abs()[samples.known].median()
