"""Recordings for Rerun's viewer, read back."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.cli.main import main
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.frame_sources.frames import Frame
from shaftpose.inference.found_shafts import FoundShaft, axis_points
from shaftpose.inference.result_stream import UnwritableError
from tests.inference.full_disk import longest_file

REASON = "rerun-sdk is not installed: in a clone, pip install '.[rerun]'"
pytest.importorskip("rerun", reason=REASON)

DEMO = Path(__file__).parents[2] / "src/shaftpose/inference/demo_frame.jpg"
AXIS = np.array([[200.0, 100.0], [260.0, 100.0]])
SHAFT = FoundShaft(
    0.9, np.array([50.0, 60, 300, 160]), AXIS, ShaftPose(1, 2, 20, 90, 0), True, "seen"
)


def matrix(rgb: Any, aspect: float) -> Any:
    height, width = rgb.shape[:2]
    return Camera.from_field_of_view(width, height, 90.0).matrix


def columns(path: Path) -> dict[str, list[Any]]:
    """Entity and component, or timeline -> the values of each frame."""
    from rerun.dataframe import load_recording

    view = load_recording(path).view(index="frame", contents="/**")
    table = view.select().read_all()
    return {name: table[name].to_pylist() for name in table.schema.names if name[0] in "/f"}


def test_frames_boxes_and_shafts_are_recorded(tmp_path: Path) -> None:
    from shaftpose.inference.rerun_file import rerun_file

    small, large = (np.full((h, w, 3), 90, dtype=np.uint8) for h, w in ((30, 40), (300, 400)))
    with rerun_file(tmp_path, matrix, 3.0) as add:
        add(Frame("a.png", 0, small), [])
        add(Frame("film.mp4", 7, large, 0.28), [SHAFT, SHAFT])
        add(Frame("film.mp4", 8, large, 0.28), [])
    found = columns(tmp_path / "predictions.rrd")
    assert found["frame"] == [0, 1, 2]
    assert [text for (text,) in found["/source:Text"]] == [
        "a.png, frame 0", "film.mp4, frame 7", "film.mp4, frame 8"
    ]  # fmt: skip
    assert [size for (size,) in found["/camera:Resolution"]] == [[40, 30], [400, 300], [400, 300]]
    # By columns.
    assert found["/camera:PinholeProjection"][1] == [
        pytest.approx([200, 0, 0, 0, 200, 0, 200, 150, 1])
    ]
    assert all(found["/camera/image:Blob"])
    assert [len(boxes) for boxes in found["/camera/image/boxes:Position2D"]] == [0, 2, 0]
    assert found["/camera/image/boxes:Position2D"][1][0] == [175.0, 110.0]
    assert found["/camera/image/boxes:HalfSize2D"][1][0] == [125.0, 50.0]
    assert found["/camera/image/boxes:Text"][1][0] == "x 1.0 y 2.0 z 20.0  p 90.0 w 0.0"
    assert [len(lines) for lines in found["/shafts:LineStrip3D"]] == [0, 2, 0]
    np.testing.assert_allclose(found["/shafts:LineStrip3D"][1][0], axis_points(SHAFT.pose))
    assert found["/shafts:Radius"][1] == [1.5]


def test_earlier_recordings_are_kept(tmp_path: Path) -> None:
    from shaftpose.inference.rerun_file import rerun_file

    (tmp_path / "predictions.rrd").write_text("earlier")
    with (
        pytest.raises(UnwritableError, match=r"predictions\.rrd: is there already"),
        rerun_file(tmp_path, matrix, None),
    ):
        pass
    assert (tmp_path / "predictions.rrd").read_text() == "earlier"


def test_a_recording_that_does_not_fit_is_named(tmp_path: Path) -> None:
    from shaftpose.inference.rerun_file import rerun_file

    noise = np.random.default_rng(0).integers(0, 255, (300, 400, 3), dtype=np.uint8)
    with (
        pytest.raises(UnwritableError, match=r"predictions\.rrd: not complete"),
        longest_file(10_000),
        rerun_file(tmp_path, matrix, None) as add,
    ):
        for number in range(3):
            add(Frame("film.mp4", number, noise, 0.28), [])


def test_predict_records_its_frames(tmp_path: Path) -> None:
    """The demo's frame has the model's own size and view."""
    main(["predict", str(DEMO), "--view-deg", "95", "--out", str(tmp_path), "--rerun"])
    found = columns(tmp_path / "predictions.rrd")
    assert len(found["/shafts:LineStrip3D"][0]) == 2
    focal_px = 299 / 2 / np.tan(np.radians(95 / 2))
    assert found["/camera:PinholeProjection"][0][0] == pytest.approx(
        [focal_px, 0, 0, 0, focal_px, 0, 149.5, 149.5, 1]
    )


def test_a_recording_needs_a_folder() -> None:
    with pytest.raises(SystemExit, match="^error: --rerun: needs a folder"):
        main(["predict", str(DEMO), "--rerun"])
