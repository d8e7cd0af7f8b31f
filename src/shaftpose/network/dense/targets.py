"""Training targets for E's maps, cell by cell.

The maps are: the tip's heat; the offset from the cell to the tip of its shaft in units of 50 px
(2); 2 log(depth / 25 mm) of the tip; the axis (3), a unit vector with z doubled.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from shaftpose.core.instruments import UNKNOWN
from shaftpose.dataset.batches import Targets
from shaftpose.network.dense.pinhole import Pinhole
from shaftpose.network.ssd.pose_coding import wrap_yaw

WAY_PX, DEPTH_MM, DEPTH_SCALE, AXIS_SCALE = 50.0, 25.0, 2.0, (1.0, 1.0, 2.0)
_HEAT_PX = 6.0  # standard deviation of a tip's heat


class DenseTargets(NamedTuple):
    """heat: (B, cells, cells) in [0, 1]; has_heat: (B,) bool, images all of whose tips are known;
    values: (B, 6, cells, cells); counts: the same shape, bool, where `values` are known."""

    heat: Tensor
    has_heat: Tensor
    values: Tensor
    counts: Tensor


def dense_targets(targets: Targets, cells: int, pinhole: Pinhole) -> DenseTargets:
    """The targets of a batch. Images without poses have heat and offsets where tips are known."""
    centres = pinhole.cell_centres(cells, targets.poses)
    has_pose = targets.valid & targets.has_pose[:, None]
    poses = torch.where(has_pose[..., None], targets.poses, torch.ones_like(targets.poses))
    tips, has_tip = pinhole.project(poses[..., :3]), has_pose
    if targets.tips_px is not None:
        annotated = targets.valid & ~has_pose & targets.tips_px.isfinite().all(-1)
        tips = torch.where(annotated[..., None], targets.tips_px, tips)
        has_tip = has_pose | annotated
    distance = (centres[None, None] - tips[:, :, None, None]).square().sum(-1)
    heat = torch.exp(-distance / (2 * _HEAT_PX**2)) * has_tip[..., None, None]
    rows = torch.cat([tips, encoded_depth(poses[..., 2:3]), encoded_axis(poses)], dim=-1)
    known = torch.cat(
        [has_tip[..., None].expand(-1, -1, 2), has_pose[..., None].expand(-1, -1, 4)], -1
    )
    assert targets.instances is not None, "this network needs instance masks for training"
    shaft = _coarse(targets.instances, cells) - 1
    # A shaft that is left out may have its tip in an image without others.
    has_unknown = (targets.instances == UNKNOWN).flatten(1).any(1)
    on_shaft = (shaft >= 0) & (shaft < rows.shape[1])  # else background or unknown
    chosen = torch.where(on_shaft, shaft, 0).flatten(1)[..., None].expand(-1, -1, rows.shape[-1])
    values, counts = (part.gather(1, chosen).unflatten(1, (cells, cells)) for part in (rows, known))
    way = (values[..., :2] - centres) / WAY_PX
    values = torch.cat([way, values[..., 2:]], dim=-1)
    return DenseTargets(
        heat=heat.amax(1),
        has_heat=(has_tip | ~targets.valid).all(1) & (targets.valid.any(1) | ~has_unknown),
        values=values.permute(0, 3, 1, 2),
        counts=(counts & on_shaft[..., None]).permute(0, 3, 1, 2),
    )


def _coarse(instances: Tensor, cells: int) -> Tensor:
    """The shaft at the centre of each cell, (B, cells, cells): 0 for none, else from 1."""
    side = instances.shape[-1]
    at = ((torch.arange(cells, device=instances.device) + 0.5) * side / cells).long()
    return instances[:, at][:, :, at].long()


def encoded_depth(depth_mm: Tensor) -> Tensor:
    """mm -> about [-2, 1]."""
    return DEPTH_SCALE * torch.log(depth_mm / DEPTH_MM)


def encoded_axis(poses: Tensor) -> Tensor:
    """Poses (..., 5) -> (..., 3): from the tip towards the handle, see docs/conventions.md."""
    pitch, yaw = torch.deg2rad(poses[..., 3]), torch.deg2rad(poses[..., 4])
    x, y = torch.sin(pitch) * torch.cos(yaw), torch.sin(pitch) * torch.sin(yaw)
    return torch.stack([x, y, -torch.cos(pitch)], dim=-1) * poses.new_tensor(AXIS_SCALE)


def decoded_poses(tips: Tensor, values: Tensor, pinhole: Pinhole) -> Tensor:
    """Tips (..., 2) px with depth and axis (..., 4) as in the maps -> poses (..., 5) mm, deg."""
    tips_mm, axis = decoded_tips_and_axes(tips, values, pinhole)
    pitch = torch.rad2deg(torch.acos((-axis[..., 2:]).clamp(-1, 1)))
    yaw = torch.rad2deg(torch.atan2(axis[..., 1:2], axis[..., :1]))
    return wrap_yaw(torch.cat([tips_mm, pitch, yaw], dim=-1))


def decoded_tips_and_axes(tips: Tensor, values: Tensor, pinhole: Pinhole) -> tuple[Tensor, Tensor]:
    """As `decoded_poses`, but tips (..., 3) mm and unit vectors (..., 3) towards the handles."""
    depth = DEPTH_MM * torch.exp(values[..., :1] / DEPTH_SCALE)
    axis = values[..., 1:] / values.new_tensor(AXIS_SCALE)
    return pinhole.lift(tips, depth), axis / axis.norm(dim=-1, keepdim=True).clamp(min=1e-6)
