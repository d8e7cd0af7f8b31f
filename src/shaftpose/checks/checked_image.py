"""Quantities of a checked image, for statistics and the split."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from shaftpose.checks.expected_sets import Body
from shaftpose.checks.rendered_image import AnnotatedImage
from shaftpose.core.cylinder import segment_distance
from shaftpose.core.geometry import Array, ShaftPose


@dataclass(frozen=True, slots=True)
class CheckedShaft:
    """The quantities of one shaft.

    The box is that of its visible part. lens_distance_mm: shortest distance from camera to axis;
    occluded_share: hidden share, None without an occluder; silhouette_iou: None if not compared.
    """

    x_mm: float
    y_mm: float
    z_mm: float
    pitch_deg: float
    yaw_deg: float
    visible_fraction: float
    box_width_px: int
    box_height_px: int
    lens_distance_mm: float
    roughness: float
    occluded_share: float | None
    silhouette_iou: float | None


@dataclass(frozen=True, slots=True)
class CheckedImage:
    """The quantities of one image.

    seed, index: the seed of its set and its number there; tries: shafts that the pose sampler drew
    for it; crossing: shafts drawn separately to pass in front of others.
    """

    key: str
    digest: bytes  # of the image file
    background: str
    source: str
    seed: int
    index: int
    tries: int
    crossing: int
    light_strength: float
    light_kelvin: float
    ambient: float
    shafts: tuple[CheckedShaft, ...]


def summary(
    key: str, image: AnnotatedImage, body: Body, ious: Sequence[float | None]
) -> CheckedImage:
    """The quantities of an image. ious: see `silhouette_ious`."""
    scene = image.scene
    return CheckedImage(
        key=key,
        digest=hashlib.blake2b(image.jpeg, digest_size=16).digest(),
        background=scene.background,
        source=scene.source,
        seed=scene.seed,
        index=scene.index,
        tries=scene.tries,
        crossing=scene.crossing,
        light_strength=scene.light.strength,
        light_kelvin=scene.light.kelvin,
        ambient=scene.light.ambient,
        shafts=tuple(_shafts(image, body, ious)),
    )


def _shafts(
    image: AnnotatedImage, body: Body, ious: Sequence[float | None]
) -> Iterator[CheckedShaft]:
    scene, hidden = image.scene, hidden_shares(image)
    each = zip(scene.shafts, image.extents, scene.steels, hidden, ious, strict=True)
    for pose, extent, steel, share, iou in each:
        _, _, width, height = extent.bbox_visib
        yield CheckedShaft(
            **vars(pose),
            visible_fraction=extent.visib_fract,
            box_width_px=width,
            box_height_px=height,
            lens_distance_mm=lens_distance(pose, body),
            roughness=steel.roughness,
            occluded_share=share,
            silhouette_iou=iou,
        )


def lens_distance(pose: ShaftPose, body: Body) -> float:
    """The shortest distance in mm from the camera to a shaft's axis."""
    lens_mm = np.zeros(3)
    return segment_distance(lens_mm, lens_mm, *shaft_axis(pose, body))


def hidden_shares(image: AnnotatedImage) -> list[float | None]:
    """The hidden share of each shaft that has an occluder, None for the others.

    The first shafts have one occluder each. Crossing shafts come last.
    """
    occluders = len(image.scene.occluders)
    return [1 - e.visib_fract if n < occluders else None for n, e in enumerate(image.extents)]


def shaft_axis(pose: ShaftPose, body: Body) -> tuple[Array, Array]:
    """The two ends of a shaft's axis, mm."""
    return pose.tip_mm, pose.tip_mm + body.length_mm * pose.direction
