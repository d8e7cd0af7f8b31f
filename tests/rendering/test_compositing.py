import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.rendering.compositing import composite, contact_shadow, darken, to_srgb

CAMERA = Camera.from_field_of_view(299, 299, 95.0)
TWIN = ((-2.0, 0.0), (2.0, 0.0))
TO_THE_RIGHT = ShaftPose(-10.0, 0.0, 22.0, 65.0, 0.0)  # and towards the camera
DOWN = ShaftPose(0.0, -10.0, 22.0, 65.0, 90.0)


def pixel(red: float, green: float, blue: float, alpha: float) -> NDArray[np.float32]:
    return np.array([[[red, green, blue, alpha]]], dtype=np.float32)


@pytest.mark.parametrize(
    ("linear", "level"),
    [(0.0, 0), (0.0031308, 10), (0.01, 25), (0.5, 188), (1.0, 255), (7.0, 255), (-0.1, 0)],
)
def test_srgb_curve(linear: float, level: int) -> None:
    assert to_srgb(np.array([linear], dtype=np.float32)) == [level]


def test_every_level_survives_linear_light_and_back() -> None:
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    background = np.stack([levels] * 3, axis=-1)
    # Even a trace of foreground makes the pixel take part in the blend.
    foreground = np.zeros((16, 16, 4), dtype=np.float32)
    foreground[..., 3] = 1e-6
    np.testing.assert_array_equal(composite(foreground, background), background)


def test_without_foreground_the_bytes_are_kept() -> None:
    background = np.random.default_rng(1).integers(0, 256, (8, 9, 3)).astype(np.uint8)
    # Light without coverage (a stray filter weight) must not be visible either.
    foreground = np.full((8, 9, 4), 0.3, dtype=np.float32)
    foreground[..., 3] = 0
    np.testing.assert_array_equal(composite(foreground, background), background)


def test_full_foreground_replaces_the_background() -> None:
    for level in (0, 255):
        background = np.full((1, 1, 3), level, dtype=np.uint8)
        np.testing.assert_array_equal(
            composite(pixel(1.0, 0.5, 0.0, 1.0), background), [[[255, 188, 0]]]
        )


def test_half_foreground_blends_in_linear_light() -> None:
    # 0.25 + 0.5 * 1 = 0.75, which is 225 in sRGB (in sRGB values it would be 0.5 * (188 + 255)).
    white = np.full((1, 1, 3), 255, dtype=np.uint8)
    np.testing.assert_array_equal(composite(pixel(0.25, 0.0, 0.5, 0.5), white), [[[225, 188, 255]]])


def test_light_is_taken_away_in_linear_light() -> None:
    levels = np.arange(256, dtype=np.uint8).reshape(1, 256, 1).repeat(3, axis=2)
    none, half = (np.full((1, 256), share, dtype=np.float32) for share in (0, 0.5))
    np.testing.assert_array_equal(darken(levels, none), levels)
    assert darken(levels, half)[0, 255].tolist() == [188] * 3  # half of the light of 255


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
