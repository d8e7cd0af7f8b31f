import numpy as np
import pytest

from shaftpose.core.geometry import Camera, ShaftPose, cylinder_depth
from shaftpose.rendering.contact_shadow import contact_shadow

CAMERA = Camera.from_field_of_view(299, 299, 95.0)
TWIN = ((-2.0, 0.0), (2.0, 0.0))
TO_THE_RIGHT = ShaftPose(-10.0, 0.0, 22.0, 65.0, 0.0)  # and towards the camera
DOWN = ShaftPose(0.0, -10.0, 22.0, 65.0, 90.0)


def shadow_of(
    pose: ShaftPose, lamps: tuple[tuple[float, float], ...] = TWIN
) -> tuple[np.ndarray, np.ndarray]:
    """The shadow and the shaft's mask."""
    mask = np.isfinite(cylinder_depth(CAMERA, pose, 3.0, 150.0))
    return contact_shadow(CAMERA, [(pose, mask)], lamps), mask


def test_without_shafts_there_is_no_shadow() -> None:
    assert not contact_shadow(CAMERA, [], TWIN).any()


def test_the_shadow_is_darkest_and_narrowest_at_the_tip() -> None:
    shadow, mask = shadow_of(TO_THE_RIGHT)
    assert 0 <= shadow.min() <= shadow.max() <= 1
    tip = int(CAMERA.project(TO_THE_RIGHT.tip_mm)[0])
    edges, widths = [], []
    for column in (tip + 12, tip + 60, tip + 120):
        below = shadow[np.flatnonzero(mask[:, column]).max() + 1 :, column]
        edges.append(below[0])
        widths.append(np.count_nonzero(below > below[0] / 4))
    assert edges[0] > edges[1] > edges[2] > 0.2
    assert widths[0] < widths[1] < widths[2]


def test_the_shadow_goes_on_to_the_images_edge() -> None:
    shadow, mask = shadow_of(TO_THE_RIGHT)
    beside = shadow[np.flatnonzero(mask[:, -1]).max() + 2]
    assert beside[-1] > 0.9 * beside[-30]


def test_a_lamp_throws_the_shadow_to_its_other_side() -> None:
    (both, mask), (left, _) = shadow_of(DOWN), shadow_of(DOWN, ((-4.0, 0.0),))
    right_side = np.arange(299) >= 150
    visible = ~mask
    np.testing.assert_allclose(both, both[:, ::-1], atol=0.02)
    assert left[visible & right_side].sum() > 2 * left[visible & ~right_side].sum()


def test_the_shadow_falls_where_geometry_says() -> None:
    """A thin shaft across the view at 20 mm, 6 mm in front of its tissue, with a lamp 12 mm to the
    left: f 12 (1/20 - 1/26) = 19.0 px to the right."""
    pose = ShaftPose(0.0, -40.0, 20.0, 90.0, 90.0)
    mask = np.zeros((299, 299), dtype=bool)
    mask[:, 149] = True
    profile = contact_shadow(CAMERA, [(pose, mask)], ((-12.0, 0.0),))[150]
    centre = (profile * np.arange(299)).sum() / profile.sum()
    assert centre == pytest.approx(149 + 19.0, abs=1.5)
