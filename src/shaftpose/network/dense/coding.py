"""Coding of tips, depths and axes in E's maps, for images of any size and camera.

A map's cell holds the offset from its centre to the tip of its shaft in units of
`OFFSET_SCALE_PX` (2 values), `DEPTH_SCALE` log(depth / `DEPTH_MM`) of the tip, and the axis
multiplied by `AXIS_SCALE` (3), a unit vector from the tip towards the handle.

The network knows no camera. Depth and axis are those that a reference camera would see at the same
pixels: the training images' focal length, its axis through the image's centre. Points of one camera
are points of the other after a linear map (`reference_points`).
"""

from typing import NamedTuple

import torch
from torch import Tensor

from shaftpose.network.pose_network import wrap_yaw

OFFSET_SCALE_PX, DEPTH_MM, DEPTH_SCALE, AXIS_SCALE = 50.0, 25.0, 2.0, (1.0, 1.0, 2.0)


def encoded_depth(depth_mm: Tensor) -> Tensor:
    """mm -> about [-2, 1]."""
    return DEPTH_SCALE * torch.log(depth_mm / DEPTH_MM)


def encoded_axis(axes: Tensor) -> Tensor:
    """Unit vectors (..., 3) -> (..., 3)."""
    return axes * axes.new_tensor(AXIS_SCALE)


def axis_vectors(poses: Tensor) -> Tensor:
    """Poses (..., 5) -> unit vectors (..., 3) towards the handles; see docs/conventions.md."""
    pitch, yaw = torch.deg2rad(poses[..., 3]), torch.deg2rad(poses[..., 4])
    x, y = torch.sin(pitch) * torch.cos(yaw), torch.sin(pitch) * torch.sin(yaw)
    return torch.stack([x, y, -torch.cos(pitch)], dim=-1)


class Grid(NamedTuple):
    """The cells of a map over an image, seen by the reference camera.

    focal_px: its focal length. size_px: (2,) width and height of the image. cells:
    (h, w, 2) px `x, y`, the centres of the cells.
    """

    focal_px: float
    size_px: Tensor
    cells: Tensor

    @classmethod
    def over(cls, image: Tensor, height: int, width: int, focal_px: float) -> "Grid":
        """A grid of height x width cells over an image (..., H, W)."""
        rows, columns = (
            (torch.arange(count, device=image.device) + 0.5) * (side / count)
            for count, side in zip((height, width), image.shape[-2:], strict=True)
        )
        y, x = torch.meshgrid(rows, columns, indexing="ij")
        cells = torch.stack([x, y], dim=-1)
        return cls(focal_px, cells[0, 0] + cells[-1, -1], cells)

    def project(self, points_mm: Tensor) -> Tensor:
        """Points (..., 3) -> (..., 2) px, as `Camera.project` for a pinhole camera."""
        return self.focal_px * points_mm[..., :2] / points_mm[..., 2:] + self.size_px / 2

    def lift(self, pixels: Tensor, depth_mm: Tensor) -> Tensor:
        """Pixels (..., 2) at a depth (..., 1) -> points (..., 3) mm."""
        offsets = (pixels - self.size_px / 2) / self.focal_px
        return torch.cat([offsets * depth_mm, depth_mm], dim=-1)


def reference_points(points: Tensor, cameras: Tensor, grid: Grid) -> Tensor:
    """The points or directions (B, N, 3) for the reference camera of those for other cameras.

    cameras: (B, 3), see `Targets`. With the camera's focal length f and principal point c, and the
    reference camera's f' and c', a point at (x, y, z) is at (x + (c - c') z / f, ..., z f' / f).
    """
    focal_px, centre = cameras[:, None, :1], cameras[:, None, 1:]
    aside = (centre - grid.size_px / 2) / focal_px
    depth = points[..., 2:]
    return torch.cat([points[..., :2] + aside * depth, depth * grid.focal_px / focal_px], dim=-1)


def decoded_poses(tips_px: Tensor, values: Tensor, grid: Grid) -> Tensor:
    """Tips (..., 2) with coded depth and axis (..., 4) -> poses (..., 5) mm, deg."""
    tips_mm, axis = decoded_tips_and_axes(tips_px, values, grid)
    pitch = torch.rad2deg(torch.acos((-axis[..., 2:]).clamp(-1, 1)))
    yaw = torch.rad2deg(torch.atan2(axis[..., 1:2], axis[..., :1]))
    return wrap_yaw(torch.cat([tips_mm, pitch, yaw], dim=-1))


def decoded_tips_and_axes(tips_px: Tensor, values: Tensor, grid: Grid) -> tuple[Tensor, Tensor]:
    """As `decoded_poses`, with tips (..., 3) mm and unit vectors (..., 3) towards the handles."""
    depth = DEPTH_MM * torch.exp(values[..., :1] / DEPTH_SCALE)
    axis = values[..., 1:] / values.new_tensor(AXIS_SCALE)
    return grid.lift(tips_px, depth), axis / axis.norm(dim=-1, keepdim=True).clamp(min=1e-6)
