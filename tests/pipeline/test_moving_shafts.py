"""A film of moving shafts, at the size of the profile `smoke`."""

import json
from pathlib import Path

import numpy as np

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.frame_sources.video_files import VideoFile
from tests.pipeline.conftest import Run


def test_a_film_of_moving_shafts_is_rendered(clone: Path, run: Run) -> None:
    result = run("python", "-m", "studies.moving_shafts", "film", "--frames", "2")
    assert result.returncode == 0, result.stderr
    first, second = VideoFile(clone / "film/film.mp4").frames()
    assert (first.fps, first.rgb.shape) == (25.0, (360, 640, 3))
    poses = json.loads((clone / "film/poses.json").read_text())
    assert [len(shafts) for shafts in poses] == [2, 2]
    # Between the frames, pixels change around the shafts only.
    changed = np.abs(first.rgb.astype(int) - second.rgb).max(axis=2) > 30
    camera = Camera.from_field_of_view(640, 640, 95.0)
    lines = [
        camera.project(pose.tip_mm + length_mm * pose.direction) - (0, (640 - 360) / 2)
        for pose in (ShaftPose(**stated) for stated in poses[0])
        for length_mm in np.linspace(0, 20, 41)
    ]
    y, x = np.nonzero(changed)
    assert len(x) > 20
    distances = np.linalg.norm(np.stack([x, y], axis=1)[:, None] - np.array(lines), axis=2)
    assert np.mean(distances.min(axis=1) < 40) > 0.9
