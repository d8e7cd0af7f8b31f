"""The visible field of a frame."""

import cv2
import numpy as np
import pytest

from shaftpose.core.geometry import Camera, Disc
from shaftpose.core.images import Image
from shaftpose.inference.fields import Picture, VisibleField, visible_field

WIDTH, HEIGHT = 532, 299


def tissue() -> Image:
    """Something bright that is not uniform, with a dark organ at its left border."""
    rng = np.random.default_rng(0)
    rgb = cv2.GaussianBlur(rng.integers(60, 250, (HEIGHT, WIDTH, 3)).astype(np.uint8), (0, 0), 5)
    rgb[100:160, :60] = 12
    return np.asarray(rgb, np.uint8)


def round_picture(disc: Disc) -> Image:
    inside = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.circle(inside, (round(disc.x), round(disc.y)), round(disc.diameter / 2), 255, cv2.FILLED)
    return np.asarray(cv2.bitwise_and(tissue(), tissue(), mask=inside), np.uint8)


def test_a_full_frame_is_its_own_field() -> None:
    assert visible_field(tissue()) == VisibleField((0, 0, WIDTH, HEIGHT))


def test_black_bars_are_no_part_of_the_field() -> None:
    frame = tissue()
    frame[:, :80] = frame[:, -60:] = 3
    field = visible_field(frame)
    assert field is not None and field.disc is None
    np.testing.assert_allclose(field.box, [80, 0, WIDTH - 60, HEIGHT], atol=3)


def test_an_instrument_from_border_to_border_does_not_part_the_field() -> None:
    frame = tissue()
    frame[200:240] = 20
    assert visible_field(frame) == VisibleField((0, 0, WIDTH, HEIGHT))


def test_dark_corners_do_not_cut_a_parted_field() -> None:
    frame = tissue()
    cv2.line(frame, (300, -20), (280, HEIGHT + 20), (6, 6, 6), 40)
    for corner in (
        [[0, HEIGHT], [150, HEIGHT], [0, HEIGHT - 150]],
        [[WIDTH, 0], [WIDTH - 150, 0], [WIDTH, 150]],
    ):
        cv2.fillPoly(frame, [np.array(corner)], (3, 3, 3))
    assert visible_field(frame) == VisibleField((0, 0, WIDTH, HEIGHT))


def test_one_side_of_a_bent_instrument_is_no_disc() -> None:
    """The right side is a part of a disc of 800 px, whose centre is not in the frame."""
    frame = tissue()
    cv2.circle(frame, (670, 150), 400, (6, 6, 6), 44)
    for corner in ([[0, HEIGHT], [100, HEIGHT], [0, HEIGHT - 100]], [[0, 0], [100, 0], [0, 100]]):
        cv2.fillPoly(frame, [np.array(corner)], (3, 3, 3))
    assert visible_field(frame) == VisibleField((0, 0, WIDTH, HEIGHT))


def test_a_round_picture_cut_by_the_frame_is_found_beside_texts_and_panels() -> None:
    disc = Disc(250.0, 140.0, 380.0)
    frame = round_picture(disc)
    cv2.putText(frame, "Flow 2.1 l/min", (2, 290), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255))
    frame[20:200, 470:530] = 90  # a panel
    field = visible_field(frame)
    assert field is not None and field.disc is not None
    found = [field.disc.x, field.disc.y, field.disc.diameter]
    np.testing.assert_allclose(found, [250, 140, 380], atol=4)
    np.testing.assert_allclose(field.box, [60, 0, 440, HEIGHT], atol=4)


def test_a_large_panel_is_no_part_of_a_round_picture() -> None:
    frame = round_picture(Disc(380.0, 150.0, 290.0))
    frame[20:280, 5:185] = 90  # 70 % of the disc's area
    field = visible_field(frame)
    assert field is not None and field.disc is not None
    found = [field.disc.x, field.disc.y, field.disc.diameter]
    np.testing.assert_allclose(found, [380, 150, 290], atol=4)


def test_a_black_frame_has_no_field() -> None:
    assert visible_field(np.full((HEIGHT, WIDTH, 3), 9, np.uint8)) is None
    nearly = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    nearly[:60, :100] = 200  # 4 % of the frame
    assert visible_field(nearly) is None
    nearly[-60:, -100:] = 200  # 8 %, in two parts
    assert visible_field(nearly) == VisibleField((0, 0, WIDTH, HEIGHT))


@pytest.mark.parametrize("times", [1, 2])
def test_a_picture_within_a_field_keeps_its_rays(times: int) -> None:
    camera = Camera(WIDTH, HEIGHT, 137.0, 260.0, 150.0)
    rgb = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    fine = np.full((times * HEIGHT, times * WIDTH, 3), 100, np.uint8)
    field = VisibleField((60, 10, 440, 290), Disc(250.0, 150.0, 380.0))
    part = Picture(rgb, fine, camera).within(field)
    assert part.rgb.shape == (280, 380, 3)
    assert part.fine is not None and part.fine.shape == (280 * times, 380 * times, 3)
    point = np.array([3.0, -2.0, 20.0])
    assert part.camera.project(point) == pytest.approx(camera.project(point) - [60, 10])
    at = np.argwhere(part.rgb[..., 0] > 0)[:, ::-1] + 0.5
    assert part.camera.shows(at).mean() > 0.99  # black outside
    assert len(at) == pytest.approx(part.camera.shows(np.argwhere(part.rgb[..., 0] >= 0)
                                                      [:, ::-1] + 0.5).sum(), rel=0.01)  # fmt: skip
    lit = (part.fine[..., 0] > 0).mean()
    assert lit == pytest.approx((part.rgb[..., 0] > 0).mean(), abs=0.01)
