"""Checks of one rendered image against its annotations and the settings it was rendered with."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from shaftpose.checks.image_facts import ImageFacts, ShaftFacts
from shaftpose.checks.rendered_image import AnnotatedImage, SceneFacts, read_image
from shaftpose.core.errors import InputError
from shaftpose.core.geometry import (
    Array,
    Camera,
    ShaftPose,
    cylinder_depth,
    pose_from_rotation,
    segment_distance,
)
from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.core.masks import crossed_share, is_crossed
from shaftpose.core.shard_schema import (
    SHAFT_OBJECT_ID,
    CameraFile,
    ExtentEntry,
    PoseEntry,
    corner_and_size,
)
from shaftpose.rendering.optics import camera_with
from shaftpose.settings.schema import LensSettings, PoseRanges, RenderSettings, SceneSettings

LEAST_IOU = 0.95  # between a mask and the silhouette computed from pose and camera
# Nearest-neighbour distortion of a mask moves its edges by up to half a pixel.
LEAST_IOU_DISTORTED = 0.9
_ROUNDING = 1e-6  # mm, or of unit vectors
_LENS = np.zeros(3)


@dataclass(frozen=True)
class Body:
    """The rod around the axis that contains the instrument, and whether the instrument is that
    rod."""

    diameter_mm: float
    length_mm: float
    is_rod: bool


def check_image(
    key: str,
    members: Mapping[str, bytes],
    settings: RenderSettings,
    body: Body,
    backgrounds: Mapping[str, str],
) -> tuple[ImageFacts | None, list[str]]:
    """The facts of an image (None if it cannot be read) and its problems, one line each.

    members: suffix -> bytes; backgrounds: file name -> id of its source.
    """
    try:
        image = read_image(members, settings.camera.size_px)
    except InputError as error:
        return None, [str(error)]
    camera = camera_with(settings, *image.camera.distortion)
    depths = cylinder_depths(image, camera, body)
    ious = silhouette_ious(image, depths)
    least = LEAST_IOU_DISTORTED if camera.k1 or camera.k2 else LEAST_IOU
    found = [
        *_problems(image, settings, camera, body, backgrounds),
        *_unlike_cylinders(image, depths),
        *_unlike_silhouettes(ious, least),
        *_outside_silhouettes(image, depths, 1 - least),
    ]
    return _facts(key, image, body, ious), found


def cylinder_depths(image: AnnotatedImage, camera: Camera, body: Body) -> list[Array] | None:
    """Depths (H, W) in mm of exact cylinders at the annotated poses, infinity elsewhere; None for
    instruments that are not plain rods.

    They are independent of Blender, so they check pose, camera and mask against each other.
    """
    if not body.is_rod:
        return None
    size = body.diameter_mm, body.length_mm
    return [cylinder_depth(camera, pose, *size) for pose in image.facts.shafts]


def silhouette_ious(image: AnnotatedImage, depths: list[Array] | None) -> list[float | None]:
    """IoU of each visible mask with the visible part of its cylinder's silhouette. All None in
    images with occluders or jaws, and for instruments that are not plain rods.

    depths: see `cylinder_depths`.
    """
    if not depths or image.facts.hides_shafts:
        return [None] * len(image.masks)
    nearest = np.argmin(depths, axis=0)
    silhouettes = [(nearest == n) & np.isfinite(depth) for n, depth in enumerate(depths)]
    each = zip(image.masks, silhouettes, strict=True)
    return [_iou(mask, silhouette) for mask, silhouette in each]


def _iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return int(np.sum(a & b)) / max(int(np.sum(a | b)), 1)


def _problems(
    image: AnnotatedImage,
    settings: RenderSettings,
    camera: Camera,
    body: Body,
    backgrounds: Mapping[str, str],
) -> Iterator[str]:
    facts = image.facts
    yield from _lens(image.camera, camera, settings.lens)
    yield from _background(facts, backgrounds)
    yield from _count(facts, settings.scene)
    yield from _chances(facts, settings.scene)
    for n, pose in enumerate(facts.shafts):
        least = settings.scene.min_visible_px
        for problem in (
            *_masks(image.masks[n], image.amodal_masks[n], image.extents[n], least),
            *_pose_entry(image.pose_entries[n], pose, facts.rolls[n]),
            *_pose(pose, settings.poses, camera),
        ):
            yield f"shaft {n}: {problem}"
    yield from _coverage(image, settings.scene)
    yield from _crossings(image, settings.scene)
    yield from _overlap(image.masks)
    yield from _collisions(facts.shafts, settings.scene.lens_radius_mm, body)


def _lens(found: CameraFile, camera: Camera, lens: LensSettings) -> Iterator[str]:
    """Check camera.json against the settings."""
    expected = CameraFile.of(camera).cam_K
    if not np.allclose(found.cam_K, expected, rtol=0, atol=_ROUNDING):
        yield f"cam_K = {found.cam_K}, not {expected}"
    ranges = {"k1": lens.distortion.k1, "k2": lens.distortion.k2}
    for value, (name, (low, high)) in zip(found.distortion, ranges.items(), strict=True):
        if not low <= value <= high:
            yield f"{name} = {value:g}: outside lens.distortion.{name} = [{low:g}, {high:g}]"
    if found.field_px != lens.field_px:
        yield f"field_px = {found.field_px}, not lens.field_px = {lens.field_px}"


def _count(facts: SceneFacts, scene: SceneSettings) -> Iterator[str]:
    """Check the number of shafts; crossing shafts are not in scene.instruments."""
    fewest, most = scene.instruments
    shafts = len(facts.shafts) - facts.crossing
    if not fewest <= shafts <= most:
        more = f" plus {facts.crossing} crossing" if facts.crossing else ""
        yield f"shafts = {shafts}{more}: outside scene.instruments = [{fewest}, {most}]"


def _chances(facts: SceneFacts, scene: SceneSettings) -> Iterator[str]:
    """Check occluders and crossings of probability 0 or 1, except in images without shafts."""
    if not facts.shafts:
        return
    if scene.occluder_probability == (0 if facts.occluders else 1):
        yield (
            f"occluders = {len(facts.occluders)}: scene.occluder_probability = "
            f"{scene.occluder_probability:g}"
        )
    if scene.crossing_probability == (0 if facts.crossing else 1):
        yield (
            f"crossing = {facts.crossing}: scene.crossing_probability = "
            f"{scene.crossing_probability:g}"
        )


def _coverage(image: AnnotatedImage, scene: SceneSettings) -> Iterator[str]:
    low, high = scene.occluder_coverage
    for n, share in enumerate(_hidden_shares(image)):
        if share is not None and not low <= share <= high:
            yield (
                f"shaft {n}: hidden share {share:.3f}: outside "
                f"scene.occluder_coverage = [{low:g}, {high:g}]"
            )


def _hidden_shares(image: AnnotatedImage) -> list[float | None]:
    """The hidden share of each shaft that has an occluder; None for the others. The first shafts
    have one occluder each; crossing shafts come last."""
    occluders = len(image.facts.occluders)
    return [1 - e.visib_fract if n < occluders else None for n, e in enumerate(image.extents)]


def _crossings(image: AnnotatedImage, scene: SceneSettings) -> Iterator[str]:
    """Check the crossing shafts, which are the last ones."""
    first = len(image.masks) - image.facts.crossing
    others = image.amodal_masks[:first]
    for n, mask in enumerate(image.masks[first:], start=first):
        share = crossed_share(mask, others)
        if not is_crossed(share, scene.crossing_coverage):
            low, high = scene.crossing_coverage
            yield (
                f"shaft {n}: hides {share:.3f} of the shaft it crosses: must be above 0 and within "
                f"scene.crossing_coverage = [{low:g}, {high:g}]"
            )


def _background(facts: SceneFacts, backgrounds: Mapping[str, str]) -> Iterator[str]:
    if facts.background not in backgrounds:
        yield f"background = {facts.background!r}: not among the backgrounds of this set"
    elif facts.source != backgrounds[facts.background]:
        yield (
            f"source = {facts.source!r}: the library has {backgrounds[facts.background]!r} for "
            f"{facts.background}"
        )


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
    if whole and abs(extent.visib_fract - visible / whole) > _ROUNDING:
        yield f"visib_fract = {extent.visib_fract}: {visible} of {whole} px are {visible / whole}"
    if visible and extent.bbox_visib != corner_and_size(mask):
        yield f"bbox_visib = {extent.bbox_visib}: the mask's extent is {corner_and_size(mask)}"
    if whole and extent.bbox_obj != corner_and_size(amodal):
        yield f"bbox_obj = {extent.bbox_obj}: the amodal extent is {corner_and_size(amodal)}"


def _unlike_cylinders(image: AnnotatedImage, depths: list[Array] | None) -> Iterator[str]:
    """Check the amodal masks of plain rods against the cylinders at their poses."""
    if depths is None:
        return
    each = zip(image.masks, image.amodal_masks, depths, strict=True)
    for n, (mask, amodal, depth) in enumerate(each):
        # Mesh and cylinder edges may differ by a pixel, so visible pixels are always expected.
        wrong = int(np.sum(amodal != (np.isfinite(depth) | mask)))
        if wrong:
            yield f"shaft {n}: {wrong} px of its amodal mask differ from its pose's silhouette"


def _pose_entry(entry: PoseEntry, pose: ShaftPose, roll_deg: float) -> Iterator[str]:
    """Check gt.json against the pose of shaft.json. Axes are compared, not angles: several yaws
    give the same axis."""
    if entry.obj_id != SHAFT_OBJECT_ID:
        yield f"obj_id = {entry.obj_id}, not {SHAFT_OBJECT_ID}"
    rotation = np.reshape(entry.cam_R_m2c, (3, 3))
    if not _is_rotation(rotation):
        yield f"cam_R_m2c = {entry.cam_R_m2c}: not a rotation matrix"
    found = pose_from_rotation(rotation, np.array(entry.cam_t_m2c))
    if not np.allclose(found.tip_mm, pose.tip_mm, rtol=0, atol=_ROUNDING):
        yield f"cam_t_m2c = {entry.cam_t_m2c}: shaft.json says {pose.tip_mm.tolist()}"
    if not np.allclose(found.direction, pose.direction, rtol=0, atol=_ROUNDING):
        yield (
            f"cam_R_m2c has pitch {found.pitch_deg:.4f} and yaw {found.yaw_deg:.4f} deg: "
            f"shaft.json says {pose.pitch_deg:.4f} and {pose.yaw_deg:.4f}"
        )
    elif _is_rotation(rotation) and not np.allclose(
        rotation, pose.rolled(roll_deg), rtol=0, atol=_ROUNDING
    ):
        yield f"cam_R_m2c = {entry.cam_R_m2c}: shaft.json says roll {roll_deg:g} deg"


def _is_rotation(matrix: Array) -> bool:
    orthogonal = np.allclose(matrix @ matrix.T, np.eye(3), rtol=0, atol=_ROUNDING)
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


def _overlap(masks: Sequence[NDArray[np.bool_]]) -> Iterator[str]:
    for (a, first), (b, second) in combinations(enumerate(masks), 2):
        shared = int(np.sum(first & second))
        if shared:
            yield f"shafts {a} and {b}: their visible masks share {shared} px"


def _collisions(poses: Sequence[ShaftPose], lens_mm: float, body: Body) -> Iterator[str]:
    """Check that shafts intersect neither the sphere around the lens nor each other."""
    axes = [_axis(pose, body.length_mm) for pose in poses]
    for n, axis in enumerate(axes):
        gap = segment_distance(_LENS, _LENS, *axis) - body.diameter_mm / 2
        if not gap > lens_mm:
            yield f"shaft {n}: {gap:.3f} mm from the camera: below scene.lens_radius_mm = {lens_mm}"
    for (a, first), (b, second) in combinations(enumerate(axes), 2):
        distance = segment_distance(*first, *second)
        if not distance > body.diameter_mm:
            yield (
                f"shafts {a} and {b}: axes {distance:.3f} mm apart: they intersect, "
                f"as their diameter is {body.diameter_mm:g} mm"
            )


def _unlike_silhouettes(ious: Sequence[float | None], least: float) -> Iterator[str]:
    for n, iou in enumerate(ious):
        if iou is not None and not iou >= least:
            yield (
                f"shaft {n}: IoU {iou:.3f} of its mask and the silhouette of its pose: below "
                f"{least}"
            )


def _outside_silhouettes(
    image: AnnotatedImage, depths: list[Array] | None, most: float
) -> Iterator[str]:
    """Check that masks in images with occluders or jaws lie inside the silhouettes of their
    poses."""
    if depths is None or not image.facts.hides_shafts:
        return
    for n, (mask, depth) in enumerate(zip(image.masks, depths, strict=True)):
        share = int(np.sum(mask & np.isinf(depth))) / max(int(mask.sum()), 1)
        if share > most:
            yield (
                f"shaft {n}: {share:.3f} of its mask lies outside the silhouette of its pose: "
                f"more than {most:g}"
            )


def _facts(key: str, image: AnnotatedImage, body: Body, ious: Sequence[float | None]) -> ImageFacts:
    facts, hidden = image.facts, _hidden_shares(image)
    each = zip(facts.shafts, image.extents, facts.steels, hidden, ious, strict=True)
    return ImageFacts(
        key=key,
        digest=hashlib.blake2b(image.jpeg, digest_size=16).digest(),
        background=facts.background,
        source=facts.source,
        seed=facts.seed,
        index=facts.index,
        tries=facts.tries,
        crossing=facts.crossing,
        light_strength=facts.light.strength,
        light_kelvin=facts.light.kelvin,
        ambient=facts.light.ambient,
        shafts=tuple(
            ShaftFacts(
                **vars(pose),
                visible_fraction=extent.visib_fract,
                box_width_px=extent.bbox_visib[2],
                box_height_px=extent.bbox_visib[3],
                lens_distance_mm=segment_distance(_LENS, _LENS, *_axis(pose, body.length_mm)),
                roughness=steel.roughness,
                occluded_share=share,
                silhouette_iou=iou,
            )
            for pose, extent, steel, share, iou in each
        ),
    )


def _axis(pose: ShaftPose, length_mm: float) -> tuple[Array, Array]:
    return pose.tip_mm, pose.tip_mm + length_mm * pose.direction
