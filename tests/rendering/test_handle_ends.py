"""A warning of shafts that are too short."""

from dataclasses import replace

import pytest

from shaftpose.rendering.handle_ends import warn_of_visible_ends
from shaftpose.settings.schema import CadSettings
from tests.pipeline.conftest import ROOT, settings_with

SETTINGS = settings_with("preset=none").rendering


@pytest.mark.parametrize("preset", ["none", "laparoscopy"])
def test_shafts_of_the_project_leave_the_image(
    preset: str, caplog: pytest.LogCaptureFixture
) -> None:
    warn_of_visible_ends(settings_with(f"preset={preset}").rendering)
    assert not caplog.text


def test_all_shafts_of_one_pose_end_in_the_image(caplog: pytest.LogCaptureFixture) -> None:
    """At 20 mm, the camera sees 20 mm tan(47.5 deg) = 21.8 mm to each side."""
    pose = {"x_mm": 0.0, "y_mm": 0.0, "z_mm": 20.0, "pitch_deg": 90.0, "yaw_deg": 0.0}
    one = replace(SETTINGS.poses, **{name: (at, at + 1e-6) for name, at in pose.items()})
    for length, ends in ((21.0, True), (22.5, False)):
        caplog.clear()
        shaft = replace(SETTINGS.shaft, length_mm=length)
        warn_of_visible_ends(replace(SETTINGS, poses=one, shaft=shaft))
        assert ("300 of 300 shafts end inside the image" in caplog.text) is ends


def test_instruments_of_a_cad_file_may_end_anywhere(caplog: pytest.LogCaptureFixture) -> None:
    cad = CadSettings(ROOT / "short.stl", "mm")
    shaft = replace(SETTINGS.shaft, length_mm=20.0, cad=cad)
    warn_of_visible_ends(replace(SETTINGS, shaft=shaft))
    assert not caplog.text
