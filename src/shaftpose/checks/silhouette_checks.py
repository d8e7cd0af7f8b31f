"""Checks of an image's masks against exact cylinders at the annotated poses.

The cylinders are independent of Blender, so they check pose, camera and mask against each other.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from shaftpose.checks.expected_sets import Body
from shaftpose.checks.rendered_image import AnnotatedImage
from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Array, Camera

_LEAST_IOU = 0.95  # between a mask and the silhouette computed from pose and camera
# Nearest-neighbour distortion of a mask moves its edges by up to half a pixel.
_LEAST_IOU_DISTORTED = 0.9


def silhouette_problems(
    image: AnnotatedImage,
    camera: Camera,
    depths: list[Array] | None,
    ious: Sequence[float | None],
) -> Iterator[str]:
    """The problems of an image's masks, one line each.

    depths: see `cylinder_depths`; ious: see `silhouette_ious`.
    """
    least = _LEAST_IOU_DISTORTED if camera.k1 or camera.k2 else _LEAST_IOU
    yield from _unlike_cylinders(image, depths)
    yield from _unlike_silhouettes(ious, least)
    yield from _outside_silhouettes(image, depths, 1 - least)


def cylinder_depths(image: AnnotatedImage, camera: Camera, body: Body) -> list[Array] | None:
    """Depths (H, W) in mm of exact cylinders at the annotated poses, infinity elsewhere; None for
    instruments that are not plain rods.
    """
    if not body.is_rod:
        return None
    size = body.diameter_mm, body.length_mm
    return [cylinder_depth(camera, pose, *size) for pose in image.scene.shafts]


def silhouette_ious(image: AnnotatedImage, depths: list[Array] | None) -> list[float | None]:
    """IoU of each visible mask with the visible part of its cylinder's silhouette. All None in
    images with occluders or jaws, and for instruments that are not plain rods.

    depths: see `cylinder_depths`.
    """
    if not depths or image.scene.hides_shafts:
        return [None] * len(image.masks)
    nearest = np.argmin(depths, axis=0)
    silhouettes = [(nearest == n) & np.isfinite(depth) for n, depth in enumerate(depths)]
    each = zip(image.masks, silhouettes, strict=True)
    return [_iou(mask, silhouette) for mask, silhouette in each]


def _iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return int(np.sum(a & b)) / max(int(np.sum(a | b)), 1)


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
    if depths is None or not image.scene.hides_shafts:
        return
    for n, (mask, depth) in enumerate(zip(image.masks, depths, strict=True)):
        share = int(np.sum(mask & np.isinf(depth))) / max(int(mask.sum()), 1)
        if share > most:
            yield (
                f"shaft {n}: {share:.3f} of its mask lies outside the silhouette of its pose: "
                f"more than {most:g}"
            )
