"""Checks of the shafts of an image: each one's pose, masks and boxes, and how they lie together."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from shaftpose.checks.checked_image import hidden_shares, lens_distance, shaft_axis
from shaftpose.checks.expected_sets import Body
from shaftpose.checks.rendered_image import AnnotatedImage
from shaftpose.core.cylinder import segment_distance
from shaftpose.core.geometry import Array, Camera, ShaftPose, pose_from_rotation
from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.core.masks import crossed_share, is_crossed
from shaftpose.core.shard_schema import SHAFT_OBJECT_ID, ExtentEntry, PoseEntry, corner_and_size
from shaftpose.settings.schema import PoseRanges, RenderSettings, SceneSettings

ROUNDING = 1e-6  # mm, or of unit vectors


def shaft_problems(
    image: AnnotatedImage, settings: RenderSettings, camera: Camera, body: Body
) -> Iterator[str]:
    """The problems of an image's shafts, one line each."""
    scene = settings.scene
    for n, pose in enumerate(image.scene.shafts):
        for problem in (
            *_masks(image.masks[n], image.amodal_masks[n], image.extents[n], scene.min_visible_px),
            *_pose_entry(image.pose_entries[n], pose, image.scene.rolls[n]),
            *_pose(pose, settings.poses, camera),
        ):
            yield f"shaft {n}: {problem}"
    yield from _coverage(image, scene)
    yield from _crossings(image, scene)
    yield from _overlap(image.masks)
    yield from _tool(image)
    yield from _collisions(image.scene.shafts, scene.lens_radius_mm, body)


def _masks(
    mask: NDArray[np.bool_], amodal: NDArray[np.bool_], extent: ExtentEntry, least_px: int
) -> Iterator[str]:
    """Check boxes, counts and fraction against the visible and the amodal mask (H, W)."""
    visible, whole = int(mask.sum()), int(amodal.sum())
    if visible < least_px:
        yield f"mask of {visible} px: fewer than scene.min_visible_px = {least_px}"
    outside = int(np.sum(mask & ~amodal))
    if outside:
        yield f"{outside} px of its visible mask are not in its amodal mask"
    if extent.px_count_visib != visible:
        yield f"px_count_visib = {extent.px_count_visib}: the mask has {visible} px"
    if extent.px_count_all != whole:
        yield f"px_count_all = {extent.px_count_all}: the amodal mask has {whole} px"
    if extent.px_count_valid != whole:
        yield f"px_count_valid = {extent.px_count_valid}: the amodal mask has {whole} px"
    if whole and abs(extent.visib_fract - visible / whole) > ROUNDING:
        yield f"visib_fract = {extent.visib_fract}: {visible} of {whole} px are {visible / whole}"
    if visible and extent.bbox_visib != corner_and_size(mask):
        yield f"bbox_visib = {extent.bbox_visib}: the mask's extent is {corner_and_size(mask)}"
    if whole and extent.bbox_obj != corner_and_size(amodal):
        yield f"bbox_obj = {extent.bbox_obj}: the amodal extent is {corner_and_size(amodal)}"


def _pose_entry(entry: PoseEntry, pose: ShaftPose, roll_deg: float) -> Iterator[str]:
    """Check gt.json against the pose of shaft.json. Axes are compared, not angles: several yaws
    give the same axis."""
    if entry.obj_id != SHAFT_OBJECT_ID:
        yield f"obj_id = {entry.obj_id}, not {SHAFT_OBJECT_ID}"
    rotation = np.reshape(entry.cam_R_m2c, (3, 3))
    if not _is_rotation(rotation):
        yield f"cam_R_m2c = {entry.cam_R_m2c}: not a rotation matrix"
    found = pose_from_rotation(rotation, np.array(entry.cam_t_m2c))
    if not np.allclose(found.tip_mm, pose.tip_mm, rtol=0, atol=ROUNDING):
        yield f"cam_t_m2c = {entry.cam_t_m2c}: shaft.json says {pose.tip_mm.tolist()}"
    if not np.allclose(found.direction, pose.direction, rtol=0, atol=ROUNDING):
        yield (
            f"cam_R_m2c has pitch {found.pitch_deg:.4f} and yaw {found.yaw_deg:.4f} deg: "
            f"shaft.json says {pose.pitch_deg:.4f} and {pose.yaw_deg:.4f}"
        )
    elif _is_rotation(rotation) and not np.allclose(
        rotation, pose.rolled(roll_deg), rtol=0, atol=ROUNDING
    ):
        yield f"cam_R_m2c = {entry.cam_R_m2c}: shaft.json says roll {roll_deg:g} deg"


def _is_rotation(matrix: Array) -> bool:
    orthogonal = np.allclose(matrix @ matrix.T, np.eye(3), rtol=0, atol=ROUNDING)
    return orthogonal and bool(np.linalg.det(matrix) > 0)


def _pose(pose: ShaftPose, ranges: PoseRanges, camera: Camera) -> Iterator[str]:
    bounds = zip(POSE_DIMENSIONS, pose.as_array(), ranges.low, ranges.high, strict=True)
    outside = [
        f"{name} = {value:g}: outside poses.{name} = [{low:g}, {high:g}]"
        for name, value, low, high in bounds
        if not low <= value <= high
    ]
    yield from outside
    if pose.z_mm > 0:
        tip = camera.project(pose.tip_mm)
        if not camera.shows(tip):
            yield f"tip at {tip[0]:.1f}, {tip[1]:.1f} px: outside the image"


def _coverage(image: AnnotatedImage, scene: SceneSettings) -> Iterator[str]:
    low, high = scene.occluder_coverage
    for n, share in enumerate(hidden_shares(image)):
        if share is not None and not low <= share <= high:
            yield (
                f"shaft {n}: hidden share {share:.3f}: outside "
                f"scene.occluder_coverage = [{low:g}, {high:g}]"
            )


def _crossings(image: AnnotatedImage, scene: SceneSettings) -> Iterator[str]:
    """Check the crossing shafts, which are the last ones."""
    first = len(image.masks) - image.scene.crossing
    others = image.amodal_masks[:first]
    for n, mask in enumerate(image.masks[first:], start=first):
        share = crossed_share(mask, others)
        if not is_crossed(share, scene.crossing_coverage):
            low, high = scene.crossing_coverage
            yield (
                f"shaft {n}: hides {share:.3f} of the shaft it crosses: must be above 0 and within "
                f"scene.crossing_coverage = [{low:g}, {high:g}]"
            )


def _overlap(masks: Sequence[NDArray[np.bool_]]) -> Iterator[str]:
    for (a, first), (b, second) in combinations(enumerate(masks), 2):
        shared = int(np.sum(first & second))
        if shared:
            yield f"shafts {a} and {b}: their visible masks share {shared} px"


def _tool(image: AnnotatedImage) -> Iterator[str]:
    """Check the tool mask: only jaws are in it, and no pixel of a shaft."""
    pixels = int(image.tool_mask.sum())
    if pixels and not any(image.scene.jaws):
        yield f"{pixels} px in the tool mask: shaft.json has no jaws"
    for n, mask in enumerate(image.masks):
        shared = int(np.sum(image.tool_mask & mask))
        if shared:
            yield f"shaft {n}: {shared} px of its visible mask are in the tool mask"


def _collisions(poses: Sequence[ShaftPose], lens_mm: float, body: Body) -> Iterator[str]:
    """Check that shafts intersect neither the sphere around the lens nor each other."""
    for n, pose in enumerate(poses):
        gap = lens_distance(pose, body) - body.diameter_mm / 2
        if not gap > lens_mm:
            yield f"shaft {n}: {gap:.3f} mm from the camera: below scene.lens_radius_mm = {lens_mm}"
    axes = [shaft_axis(pose, body) for pose in poses]
    for (a, first), (b, second) in combinations(enumerate(axes), 2):
        distance = segment_distance(*first, *second)
        if not distance > body.diameter_mm:
            yield (
                f"shafts {a} and {b}: axes {distance:.3f} mm apart: they intersect, "
                f"as their diameter is {body.diameter_mm:g} mm"
            )
