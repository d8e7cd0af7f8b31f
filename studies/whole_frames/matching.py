"""Which detections show which true shafts of a frame.

Lengths in px are those of an image whose shorter side has 299 px.

- A true tip is `outside` of the picture; `hidden` if nine tenths of the shaft's pixels within one
  radius of it are; else `seen`. A shaft with fewer than 400 visible px does not count.
- Detections and seen tips within 15 px are matched one to one, nearest pairs first: a detection
  then finds the tip's shaft.
- A shaft without a seen tip, or one that does not count, is found by a remaining detection at least
  half of whose silhouette lies on the shaft's.
- A detection that finds nothing is false, and so is one that finds a shaft without a seen tip and
  calls its own tip seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Array, Camera, ShaftPose
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.metrics.detection.matching import nearest_pairs
from shaftpose.refinement.contour import Shaft
from shaftpose.refinement.refiner import TipState
from studies.whole_frames.frames import AnnotatedFrame

REACH, LEAST_VISIBLE = 15 / 299, 400 / 299**2  # of the shorter side, and of its square
HIDDEN, ON_SHAFT = 0.9, 0.5
_STRIDE = 4  # of silhouettes

Masks = NDArray[np.bool_]


@dataclass(frozen=True)
class TrueShaft:
    """A shaft of a frame. found: the detection that finds it.

    pose: (5,). tip_px: (2,). beside: whether its tip lies beside the frame's central square.
    counts: whether enough of it is visible. crossed: whether its silhouette meets another one's.
    """

    pose: Array
    tip_px: Array
    tip: TipState
    beside: bool
    counts: bool
    crossed: bool
    found: FoundShaft | None


@dataclass(frozen=True)
class Detection:
    """A detection. at_edge: whether its tip lies within 15 px of the picture's border."""

    found: FoundShaft
    is_false: bool
    at_edge: bool


def compared(
    frame: AnnotatedFrame,
    found: Sequence[FoundShaft],
    seen_by: Camera,
    rod: Shaft,
    found_rod: Shaft,
) -> tuple[list[TrueShaft], list[Detection]]:
    """The shafts of a frame, and all detections, best score first.

    seen_by: the camera of the detections' poses, in px of the frame. rod, found_rod: the true
    shafts, and those of the detections' poses.
    """
    camera, reach_px = frame.camera, REACH * frame.short_px
    tips_px = camera.project(frame.poses[:, :3])
    states = [_tip_state(frame, number, rod) for number in range(len(frame.poses))]
    counts = frame.masks.sum(axis=(1, 2)) >= LEAST_VISIBLE * frame.short_px**2
    bodies = _silhouettes(camera, [ShaftPose.from_array(pose) for pose in frame.poses], rod)
    seen_by = replace(seen_by, field=camera.field)
    on = _shares_on(_silhouettes(seen_by, [one.pose for one in found], found_rod), bodies)
    found_px = np.reshape([one.tip_px for one in found], (-1, 2))
    by_tip, by_body = _pairs(tips_px, np.array(states), counts, found_px, on, reach_px)

    finds = by_tip | by_body
    right = {*by_tip.values(), *(k for k in by_body.values() if found[k].tip != "seen")}
    aside = np.abs(tips_px - np.array([camera.width, camera.height]) / 2).max(axis=1, initial=0)
    shafts = [
        TrueShaft(
            frame.poses[g], tips_px[g], state, bool(aside[g] > frame.short_px / 2),
            bool(counts[g]), _meets_another(bodies, g), found[finds[g]] if g in finds else None,
        )
        for g, state in enumerate(states)
    ]  # fmt: skip
    at_edge = (camera.border_px(found_px) < reach_px).tolist()
    return shafts, [Detection(one, k not in right, at_edge[k]) for k, one in enumerate(found)]


def _pairs(
    tips_px: Array,
    states: NDArray[np.str_],
    counts: NDArray[np.bool_],
    found_px: Array,
    on: Array,
    reach_px: float,
) -> tuple[dict[int, int], dict[int, int]]:
    """The detections that find shafts by their tips, and those that find others by lying on them.

    on: (G, K), the share of each detection's silhouette that lies on each shaft's.
    """
    distances = np.linalg.norm(tips_px[:, None] - found_px, axis=-1)
    distances[states != "seen"] = np.inf
    by_tip = nearest_pairs(distances, reach_px)
    off = 1 - on
    off[(states == "seen") & counts] = np.inf
    off[list(by_tip)] = off[:, list(by_tip.values())] = np.inf
    return by_tip, nearest_pairs(off, 1 - ON_SHAFT)


def _silhouettes(camera: Camera, poses: Sequence[ShaftPose], rod: Shaft) -> Masks:
    """The silhouettes (N, pixels), hidden parts included."""
    size, pixels = (rod.diameter_mm, rod.length_mm), camera.rays(_STRIDE)[..., 0].size
    depths = [cylinder_depth(camera, pose, *size, _STRIDE) for pose in poses]
    return np.isfinite(np.reshape(depths, (-1, pixels)))


def _shares_on(found: Masks, true: Masks) -> Array:
    """(G, K) share of each found silhouette (K, pixels) that lies on each true one (G, pixels)."""
    common = true.astype(np.float64) @ found.T.astype(np.float64)
    return np.asarray(common / np.maximum(found.sum(axis=1), 1))


def _meets_another(bodies: Masks, number: int) -> bool:
    return bool((bodies[number] & np.delete(bodies, number, axis=0)).any())


def _tip_state(frame: AnnotatedFrame, number: int, rod: Shaft) -> TipState:
    """The state of a true tip."""
    pose, camera = ShaftPose.from_array(frame.poses[number]), frame.camera
    tip_px = camera.project(pose.tip_mm)
    if not camera.shows(tip_px):
        return "outside"
    radius_px = camera.focal_px * rod.diameter_mm / 2 / pose.z_mm
    low = np.maximum(np.floor(tip_px - radius_px), 0).astype(int)
    high = np.minimum(np.ceil(tip_px + radius_px), [camera.width, camera.height]).astype(int)
    (x0, y0), (x1, y1) = low.tolist(), high.tolist()
    around = camera.cropped(x0, y0, x1 - x0, y1 - y0)
    rows, columns = np.mgrid[y0:y1, x0:x1] + 0.5
    near = np.hypot(columns - tip_px[0], rows - tip_px[1]) <= radius_px
    near &= np.isfinite(cylinder_depth(around, pose, rod.diameter_mm, rod.length_mm))
    hidden = np.count_nonzero(near & ~frame.masks[number, y0:y1, x0:x1])
    return "hidden" if hidden >= HIDDEN * near.sum() else "seen"
