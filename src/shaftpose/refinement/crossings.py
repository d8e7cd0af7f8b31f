"""Shafts that meet in the image: edges on one of them are not the outline of another."""

from collections.abc import Sequence

import cv2
import numpy as np

from shaftpose.core.geometry import Camera
from shaftpose.refinement.contour import Array, Contour, Shaft
from shaftpose.refinement.edges import Offsets
from shaftpose.refinement.fit import Search
from shaftpose.refinement.outlines import Outline, visible_outline

_MARGIN_PX = 2.0  # around another shaft: edges so near to it may be its own


def met_outlines(poses: Array, shaft: Shaft, camera: Camera) -> list[list[Outline]]:
    """For each of the poses (K, 5), the outlines of the other shafts that it meets in the image."""
    outlines = [visible_outline(pose, shaft, camera) for pose in poses]
    return [
        [other for other in outlines if other is not own and _meet(own, other)] for own in outlines
    ]


def leaving_out(outlines: Sequence[Outline], search: Search, times: int = 1) -> Search:
    """A search of edges that ignores the samples on other shafts.

    times: pixels of the searched picture for one of the outlines' image.
    """

    def search_elsewhere(contour: Contour, reach_px: float) -> Offsets:
        found = search(contour, reach_px)
        covered = np.zeros(len(found.weights), dtype=bool)
        for outline in outlines:
            covered |= [_near(outline, point) for point in contour.points / times]
        return Offsets(found.px, np.where(covered, 0.0, found.weights))

    return search_elsewhere if outlines else search


def _meet(one: Outline, other: Outline) -> bool:
    # Where both end at one border, OpenCV sees some intersections in one of the orders alone.
    orders = ((one, other), (other, one)) if len(one) and len(other) else ()
    return any(cv2.intersectConvexConvex(*order)[0] > 0 for order in orders)


def _near(outline: Outline, point: Array) -> bool:
    x, y = point.tolist()
    return cv2.pointPolygonTest(outline, (x, y), True) > -_MARGIN_PX
