"""Decoding of E's mask and maps: peaks of the tip heat map, and the pixels that vote for them."""

import torch
from torch import Tensor
from torch.nn import functional

from shaftpose.network.dense.coding import (
    OFFSET_SCALE_PX,
    Grid,
    decoded_poses,
    decoded_tips_and_axes,
)
from shaftpose.network.pose_network import DecodedOutputs, gather_rows
from shaftpose.settings.schema import DetectionSettings

_PEAK_CELLS = 5  # window in which a peak is the maximum, along x and y
# Largest distance between a tip and a pixel's vote for it: this plus a share of the voted offset.
_VOTE_PX, _VOTE_SHARE = 15.0, 0.3
_LEAST_SCORE = 0.1  # minimum score of peaks that get pixels
_BESIDE_PX = 8.0  # distance from a tip up to which a cell has a small weight in any case
# Cells that give a shaft's direction: next to its tip, with an exact vote.
_NEAR_PX, _NEAR_VOTE_PX = 12.0, 8.0
# Distance from a shaft's axis that counts as much as a vote at its limit: this plus a share of the
# distance along the axis. So touching shafts stay apart.
_ACROSS_PX, _ACROSS_SHARE = 48.0, 0.8


def decode(
    mask: Tensor, maps: Tensor, fine: Grid, grid: Grid, limits: DetectionSettings
) -> DecodedOutputs:
    """One instrument for each of the highest peaks of the tip heat map.

    Its pose is the mean over the mask's cells that vote for the peak, its box the extent of the
    mask's pixels that belong to it. mask: (B, 1, h, w) logits in the cells of `fine`; maps:
    (B, 7, h, w) in the cells of `grid`.
    """
    mask, maps = mask.float(), maps.float()
    heat, centres = maps[:, 0].sigmoid(), grid.cells
    scores, peaks = _peaks(heat, limits.max_detections)
    tips = _refined(heat, centres, peaks)
    coarse = functional.interpolate(mask, size=maps.shape[-2:], mode="bilinear")
    directions = _directions(coarse, maps, tips, grid)
    belongs, far = _belonging(coarse, maps, tips, directions, scores, grid)
    weights = _weights(belongs, far, centres, tips)
    poses = decoded_poses(tips, _means(maps, weights), grid)
    belongs, _ = _belonging(mask, maps, tips, directions, scores, fine)
    boxes, seen = _extents(belongs, fine)
    scores = scores * seen
    found = (scores > 0)[..., None]
    scores, order = scores.sort(dim=1, descending=True)
    boxes, poses = torch.where(found, boxes, 0.0), torch.where(found, poses, 0.0)
    return DecodedOutputs(gather_rows(boxes, order), scores, gather_rows(poses, order))


def _peaks(heat: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Scores and cells (B, count) of the highest peaks; missing peaks have score 0."""
    highest = functional.max_pool2d(heat[:, None], _PEAK_CELLS, 1, _PEAK_CELLS // 2)[:, 0]
    return torch.where(heat == highest, heat, 0.0).flatten(1).topk(count, dim=1)


def _refined(heat: Tensor, centres: Tensor, peaks: Tensor) -> Tensor:
    """Tips (B, K, 2) px: means around the peaks, weighted by the squared heat."""
    around = functional.unfold(heat[:, None].square(), 3, padding=1)
    weights = around.gather(2, peaks[:, None].expand(-1, 9, -1)).transpose(1, 2)
    step = centres[0, 1] - centres[0, 0] + centres[1, 0] - centres[0, 0]
    offsets = torch.tensor([[x, y] for y in (-1, 0, 1) for x in (-1, 0, 1)], device=heat.device)
    middle = centres.flatten(0, 1)[peaks]
    shift = (weights @ (offsets * step)) / weights.sum(-1, keepdim=True).clamp(min=1e-9)
    return middle + shift


def _directions(mask: Tensor, maps: Tensor, tips: Tensor, grid: Grid) -> Tensor:
    """Unit vectors (B, K, 2) of the axes in the image, from the cells next to the tips."""
    centres = grid.cells.permute(2, 0, 1)
    away = _distances(*_offsets(centres[None], tips))
    far = _distances(*_offsets(centres + OFFSET_SCALE_PX * maps[:, 1:3], tips))
    exact = (away < _NEAR_PX) & (far < _NEAR_VOTE_PX) & (mask > 0)
    weights = (exact.float() + 1e-3 * (away < _BESIDE_PX).float()).flatten(2)
    tips_mm, axes = decoded_tips_and_axes(tips, _means(maps, weights), grid)
    steps = grid.project(tips_mm + axes) - tips
    return steps / steps.norm(dim=-1, keepdim=True).clamp(min=1e-6)


def _means(maps: Tensor, weights: Tensor) -> Tensor:
    """Depth and axis (B, K, 4) as in the maps: means over cells, weighted (B, K, cells * cells)."""
    values = torch.einsum("bkn,bcn->bkc", weights, maps[:, 3:].flatten(2))
    return values / weights.sum(-1, keepdim=True).clamp(min=1e-6)


def _belonging(
    mask: Tensor, maps: Tensor, tips: Tensor, directions: Tensor, scores: Tensor, grid: Grid
) -> tuple[Tensor, Tensor]:
    """Assign the mask's pixels to tips.

    Returns whether a pixel belongs to a tip, (B, K, h, w) bool, and the distance of its vote, the
    place that its offset points to, from that tip in px.

    A pixel chooses the tip for which the sum of two ratios is least: the distance of its vote from
    the tip to a limit, which grows with the offset because long offsets are less exact; and its own
    distance from the tip's axis to another limit, which parts shafts that touch. It belongs to that
    tip if the vote is within its limit. Peaks of low score get no pixels.
    """
    size = mask.shape[-2:]
    votes = OFFSET_SCALE_PX * functional.interpolate(maps[:, 1:3], size=size, mode="bilinear")
    centres = grid.cells.permute(2, 0, 1)
    far = _distances(*_offsets(centres + votes, tips))
    limit = _VOTE_PX + _VOTE_SHARE * votes.norm(dim=1, keepdim=True)
    x, y = _offsets(centres[None], tips)
    u, v = (part[:, :, None, None] for part in directions.unbind(-1))
    across = (x * v - y * u).abs() / (_ACROSS_PX + _ACROSS_SHARE * (x * u + y * v).abs())
    rivals = far / limit + across.clamp(max=1)
    rivals = torch.where((scores > _LEAST_SCORE)[..., None, None], rivals, float("inf"))
    nearest = (rivals == rivals.amin(dim=1, keepdim=True)) & rivals.isfinite()
    return nearest & (far < limit) & (mask > 0), far


def _offsets(points: Tensor, tips: Tensor) -> tuple[Tensor, Tensor]:
    """x and y, (B, K, h, w) each, from tips (B, K, 2) to points (1 or B, 2, h, w)."""
    (x, y), (tip_x, tip_y) = points.unbind(1), tips.unbind(-1)
    return x[:, None] - tip_x[..., None, None], y[:, None] - tip_y[..., None, None]


def _distances(x: Tensor, y: Tensor) -> Tensor:
    return (x.square() + y.square()).sqrt()  # `torch.hypot` cannot be exported


def _weights(belongs: Tensor, far: Tensor, centres: Tensor, tips: Tensor) -> Tensor:
    """Weights (B, K, cells * cells) of the cells for the pose of each tip: full if they belong to
    it and their votes are near, and a little next to the tip in any case."""
    beside = _distances(*_offsets(centres.permute(2, 0, 1)[None], tips)) < _BESIDE_PX
    return ((belongs & (far < _VOTE_PX)).float() + 1e-3 * beside.float()).flatten(2)


def _extents(belongs: Tensor, grid: Grid) -> tuple[Tensor, Tensor]:
    """Extents (B, K, 4) px of the pixels (B, K, h, w), and (B, K) 1 if there are any, else 0."""
    half = grid.cells[0, 0]  # the first cell's centre is half a cell from the image's corner
    ends = []
    for axis, centres in enumerate((grid.cells[0, :, 0], grid.cells[:, 0, 1])):
        occupied = belongs.any(dim=2 + axis)  # over rows for x, over columns for y
        low = torch.where(occupied, centres, float("inf")).amin(-1) - half[axis]
        high = torch.where(occupied, centres, float("-inf")).amax(-1) + half[axis]
        ends.append((low, high))
    (x0, x1), (y0, y1) = ends
    return torch.stack([x0, y0, x1, y1], dim=-1), belongs.any(dim=3).any(dim=2).float()
