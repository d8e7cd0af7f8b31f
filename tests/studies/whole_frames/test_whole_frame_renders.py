"""Settings of larger renders with other view angles."""

from pathlib import Path

import pytest

from shaftpose.core.geometry import Camera
from shaftpose.settings.compose import composed_settings
from studies.whole_frames.rendering import SQUARES, Squares, enlarged
from studies.whole_frames.rows import ROWS

ROOT = Path(__file__).parents[3]
SETTINGS = composed_settings(ROOT, "lens.blur_px=[0,1]", "lens.field_px=400").rendering


def test_a_tip_at_the_end_of_the_range_stays_where_it_is_in_the_picture() -> None:
    narrow = enlarged(SETTINGS, Squares(598, 40, 1, {}))
    places = []
    for settings in (SETTINGS, narrow):
        size_px, view_deg = settings.camera.size_px, settings.camera.view_deg
        focal_px = Camera.from_field_of_view(size_px, size_px, view_deg).focal_px
        places.append(focal_px * settings.poses.x_mm[1] / settings.poses.z_mm[1] / size_px)
    assert places[0] == pytest.approx(places[1])
    assert narrow.poses.z_mm == SETTINGS.poses.z_mm


def test_pixels_grow_with_the_picture() -> None:
    larger = enlarged(SETTINGS, Squares(598, 95, 1, {"crossing_probability": 1.0}))
    assert larger.poses == SETTINGS.poses
    assert larger.scene.min_visible_px == 4 * SETTINGS.scene.min_visible_px
    assert larger.scene.crossing_probability == 1
    assert (larger.lens.blur_px, larger.lens.field_px) == ((0, 2), 800)


def test_every_row_names_sets_that_are_rendered() -> None:
    named = {name for row in ROWS.values() for name in row.squares}
    assert named == SQUARES.keys()
