"""Frames in other shapes keep their shafts where they are."""

import numpy as np
import pytest

from shaftpose.core.geometry import Array, Camera
from studies.whole_frames.frames import (
    AnnotatedFrame,
    as_rendered,
    inscribed_disc,
    inscribed_disc_and_panel,
    larger_disc,
    wide,
)

TIP = np.array([[2.0, 1, 20, 90, 0]])


def square(side_px: int) -> AnnotatedFrame:
    """A bright square; a shaft covers it."""
    camera = Camera.from_field_of_view(side_px, side_px, 95.0)
    rgb = np.full((side_px, side_px, 3), 200, np.uint8)
    return AnnotatedFrame(rgb, camera, TIP, np.ones((1, side_px, side_px), bool))


def tip_px(frame: AnnotatedFrame) -> Array:
    return frame.camera.project(frame.poses[0, :3])


def test_a_wide_frame_is_the_middle_of_a_square() -> None:
    whole = square(1911)
    whole.rgb[415] = 7
    cut = wide(whole, 0)
    assert cut.rgb.shape == (1080, 1911, 3)
    assert (cut.rgb[0] == 7).all()
    assert cut.masks.shape == (1, 1080, 1911)
    assert cut.short_px == 1080
    assert cut.view_deg == pytest.approx(63.33, abs=0.01)
    assert tip_px(cut) == pytest.approx(tip_px(whole) - [0, 415])
    assert as_rendered(whole, 0).view_deg == pytest.approx(95)


def test_a_round_picture_is_black_outside() -> None:
    whole = square(100)
    disc = inscribed_disc(whole, 0)
    assert disc.masks.sum() == pytest.approx(np.pi * 50**2, rel=0.01)
    assert (disc.rgb.any(axis=2) == disc.masks[0]).all()
    assert not disc.camera.shows(np.array([5.0, 5]))
    larger = larger_disc(whole, 0)
    # Its centre is at 53 and 48, its radius 54: it meets the left border at -1.
    assert larger.masks[0, 48].all()
    assert larger.masks.sum() > disc.masks.sum()


def test_a_panel_lies_beside_the_picture() -> None:
    whole = square(540)
    framed = inscribed_disc_and_panel(whole, 0)
    assert framed.rgb.shape == (540, 960, 3)
    assert not framed.masks[:, :, 540:].any()
    assert not framed.rgb[:, 540:580].any()
    assert framed.rgb[:, 580:920].any()
    assert tip_px(framed) == pytest.approx(tip_px(whole))
    assert not framed.camera.shows(np.array([700.0, 270]))
    assert framed.camera.shows(np.array([270.0, 270]))
