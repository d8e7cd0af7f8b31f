"""Checks of one rendered image against its annotations and the settings it was rendered with."""

from collections.abc import Iterator, Mapping

import numpy as np

from shaftpose.checks.checked_image import CheckedImage, summary
from shaftpose.checks.expected_sets import Body
from shaftpose.checks.rendered_image import SceneFile, read_image
from shaftpose.checks.shaft_checks import ROUNDING, shaft_problems
from shaftpose.checks.silhouette_checks import (
    cylinder_depths,
    silhouette_ious,
    silhouette_problems,
)
from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera
from shaftpose.core.shard_schema import CameraFile
from shaftpose.rendering.optics import camera_with
from shaftpose.settings.schema import LensSettings, RenderSettings, SceneSettings


def check_image(
    key: str,
    members: Mapping[str, bytes],
    settings: RenderSettings,
    body: Body,
    backgrounds: Mapping[str, str],
) -> tuple[CheckedImage | None, list[str]]:
    """The quantities of an image (None if it cannot be read) and its problems, one line each.

    members: suffix -> bytes; backgrounds: file name -> id of its source.
    """
    try:
        image = read_image(members, settings.camera.size_px)
    except InputError as error:
        return None, [str(error)]
    camera = camera_with(settings, *image.camera.distortion)
    depths = cylinder_depths(image, camera, body)
    ious = silhouette_ious(image, depths)
    found = [
        *_lens(image.camera, camera, settings.lens),
        *_background(image.scene, backgrounds),
        *_count(image.scene, settings.scene),
        *_samples(image.scene.samples, settings.samples),
        *_chances(image.scene, settings.scene),
        *shaft_problems(image, settings, camera, body),
        *silhouette_problems(image, camera, depths, ious),
    ]
    return summary(key, image, body, ious), found


def _lens(found: CameraFile, camera: Camera, lens: LensSettings) -> Iterator[str]:
    """Check camera.json against the settings."""
    expected = CameraFile.of(camera).cam_K
    if not np.allclose(found.cam_K, expected, rtol=0, atol=ROUNDING):
        yield f"cam_K = {found.cam_K}, not {expected}"
    ranges = {"k1": lens.distortion.k1, "k2": lens.distortion.k2}
    for value, (name, (low, high)) in zip(found.distortion, ranges.items(), strict=True):
        if not low <= value <= high:
            yield f"{name} = {value:g}: outside lens.distortion.{name} = [{low:g}, {high:g}]"
    if found.field_px != lens.field_px:
        yield f"field_px = {found.field_px}, not lens.field_px = {lens.field_px}"


def _count(found: SceneFile, scene: SceneSettings) -> Iterator[str]:
    """Check the number of shafts; crossing shafts are not in scene.instruments."""
    fewest, most = scene.instruments
    shafts = len(found.shafts) - found.crossing
    if not fewest <= shafts <= most:
        more = f" plus {found.crossing} crossing" if found.crossing else ""
        yield f"shafts = {shafts}{more}: outside scene.instruments = [{fewest}, {most}]"


def _samples(found: int, ends: tuple[int, int]) -> Iterator[str]:
    low, high = ends
    if not low <= found <= high:
        yield f"samples = {found}: outside the profile's samples = [{low}, {high}]"


def _chances(found: SceneFile, scene: SceneSettings) -> Iterator[str]:
    """Check occluders and crossings of probability 0 or 1, except in images without shafts."""
    if not found.shafts:
        return
    if scene.occluder_probability == (0 if found.occluders else 1):
        yield (
            f"occluders = {len(found.occluders)}: scene.occluder_probability = "
            f"{scene.occluder_probability:g}"
        )
    if scene.crossing_probability == (0 if found.crossing else 1):
        yield (
            f"crossing = {found.crossing}: scene.crossing_probability = "
            f"{scene.crossing_probability:g}"
        )


def _background(found: SceneFile, backgrounds: Mapping[str, str]) -> Iterator[str]:
    if found.background not in backgrounds:
        yield f"background = {found.background!r}: not among the backgrounds of this set"
    elif found.source != backgrounds[found.background]:
        yield (
            f"source = {found.source!r}: the library has {backgrounds[found.background]!r} for "
            f"{found.background}"
        )
