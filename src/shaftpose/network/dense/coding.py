"""Coding of tips, depths and axes in E's maps.

A map's cell holds the offset from its centre to the tip of its shaft in units of
`OFFSET_SCALE_PX` (2 values), `DEPTH_SCALE` log(depth / `DEPTH_MM`) of the tip, and the axis
multiplied by `AXIS_SCALE` (3), a unit vector from the tip towards the handle.
"""

import torch
from torch import Tensor

from shaftpose.core.geometry import Camera
from shaftpose.network.pose_network import wrap_yaw

OFFSET_SCALE_PX, DEPTH_MM, DEPTH_SCALE, AXIS_SCALE = 50.0, 25.0, 2.0, (1.0, 1.0, 2.0)


def encoded_depth(depth_mm: Tensor) -> Tensor:
    """mm -> about [-2, 1]."""
    return DEPTH_SCALE * torch.log(depth_mm / DEPTH_MM)


def encoded_axis(poses: Tensor) -> Tensor:
    """Poses (..., 5) -> (..., 3); see docs/conventions.md for the angles."""
    pitch, yaw = torch.deg2rad(poses[..., 3]), torch.deg2rad(poses[..., 4])
    x, y = torch.sin(pitch) * torch.cos(yaw), torch.sin(pitch) * torch.sin(yaw)
    return torch.stack([x, y, -torch.cos(pitch)], dim=-1) * poses.new_tensor(AXIS_SCALE)


def decoded_poses(tips_px: Tensor, values: Tensor, camera: Camera) -> Tensor:
    """Tips (..., 2) with coded depth and axis (..., 4) -> poses (..., 5) mm, deg."""
    tips_mm, axis = decoded_tips_and_axes(tips_px, values, camera)
    pitch = torch.rad2deg(torch.acos((-axis[..., 2:]).clamp(-1, 1)))
    yaw = torch.rad2deg(torch.atan2(axis[..., 1:2], axis[..., :1]))
    return wrap_yaw(torch.cat([tips_mm, pitch, yaw], dim=-1))


def decoded_tips_and_axes(tips_px: Tensor, values: Tensor, camera: Camera) -> tuple[Tensor, Tensor]:
    """As `decoded_poses`, with tips (..., 3) mm and unit vectors (..., 3) towards the handles."""
    depth = DEPTH_MM * torch.exp(values[..., :1] / DEPTH_SCALE)
    axis = values[..., 1:] / values.new_tensor(AXIS_SCALE)
    return lift(tips_px, depth, camera), axis / axis.norm(dim=-1, keepdim=True).clamp(min=1e-6)


def project(points_mm: Tensor, camera: Camera) -> Tensor:
    """Points (..., 3) -> (..., 2) px, as `Camera.project` for a pinhole camera."""
    centre = points_mm.new_tensor((camera.cx, camera.cy))
    return camera.focal_px * points_mm[..., :2] / points_mm[..., 2:] + centre


def lift(pixels: Tensor, depth_mm: Tensor, camera: Camera) -> Tensor:
    """Pixels (..., 2) of a pinhole camera at a depth (..., 1) -> points (..., 3) mm."""
    centre = pixels.new_tensor((camera.cx, camera.cy))
    return torch.cat([(pixels - centre) / camera.focal_px * depth_mm, depth_mm], dim=-1)


def cell_centres(cells: int, side_px: int, device: torch.device) -> Tensor:
    """(cells, cells, 2) px `x, y` of a grid over a square image."""
    centres = (torch.arange(cells, device=device) + 0.5) * (side_px / cells)
    y, x = torch.meshgrid(centres, centres, indexing="ij")
    return torch.stack([x, y], dim=-1)
