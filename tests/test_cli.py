"""The command line."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.cli import main
from shaftpose.deployment.onnx_export import store_metadata
from shaftpose.geometry import Camera, ShaftPose
from shaftpose.shards import Instrument, Sample, ShardWriter, sample_key, shard_name

FIRST = {
    "score": 0.75, "box": [10.0, 20.0, 110.0, 220.0],
    "x_mm": 1.0, "y_mm": -2.0, "z_mm": 20.0, "pitch_deg": 70.0, "yaw_deg": 123.0,
}  # fmt: skip


@pytest.fixture
def frame(tmp_path: Path) -> Path:
    path = tmp_path / "frame.png"
    cv2.imwrite(str(path), np.full((300, 400, 3), 90, dtype=np.uint8))
    return path


def test_predict_prints_what_reaches_the_models_confidence(
    constant_model: Path, frame: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store_metadata(constant_model, 0.5, 95.0, 3.0)
    main(["predict", str(frame), str(frame), "--model", str(constant_model)])
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert lines == [{"image": str(frame), "instruments": [FIRST]}] * 2


def test_the_users_confidence_goes_first(
    constant_model: Path, frame: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["predict", str(frame), "--model", str(constant_model), "--confidence"]
    counts = []
    for confidence in ("0", "0.3", "0.8"):
        main([*arguments, confidence])
        counts.append(len(json.loads(capsys.readouterr().out)["instruments"]))
    assert counts == [2, 1, 0]


def test_predict_draws_where_it_is_told(constant_model: Path, frame: Path, tmp_path: Path) -> None:
    out = tmp_path / "found"
    arguments = ["--model", str(constant_model), "--confidence", "0.5", "--draw", str(out)]
    main(["predict", str(frame), *arguments])
    drawn = cv2.imread(str(out / "frame.jpg"))
    assert drawn.shape == (299, 299, 3)
    assert np.ptp(drawn) > 100  # the frame alone is of one grey


def test_poses_are_drawn_for_the_models_camera_or_the_users(
    constant_model: Path, frame: Path, tmp_path: Path
) -> None:
    arguments = ["predict", str(frame), "--model", str(constant_model), "--draw"]
    drawn = {}
    for name, view_deg, more in (("own", 60.0, []), ("stated", 95.0, ["--view-deg", "60"]),
                                 ("other", 95.0, [])):  # fmt: skip
        store_metadata(constant_model, 0.5, view_deg, 3.0)
        main([*arguments, str(tmp_path / name), *more])
        drawn[name] = (tmp_path / name / "frame.jpg").read_bytes()
    assert drawn["own"] == drawn["stated"] != drawn["other"]


def test_no_image_is_overwritten_by_a_drawing(
    constant_model: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo = tmp_path / "a" / "frame.jpg"
    photo.parent.mkdir()
    cv2.imwrite(str(photo), cv2.imread(str(frame)))
    before = photo.read_bytes()
    arguments = ["--model", str(constant_model), "--confidence", "0", "--draw"]
    with pytest.raises(SystemExit, match="^error: --draw .*is taken by another image"):
        main(["predict", str(photo), *arguments, str(photo.parent)])
    assert photo.read_bytes() == before
    with pytest.raises(SystemExit, match="^error: --draw .*is taken by another image"):
        main(["predict", str(photo), str(frame), *arguments, str(tmp_path / "found")])
    assert not (tmp_path / "found").exists()
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("image", ["missing.png", "text.png"])
def test_an_unreadable_image_ends_with_one_line(
    image: str, constant_model: Path, tmp_path: Path
) -> None:
    (tmp_path / "text.png").write_text("no image")
    with pytest.raises(SystemExit, match=rf"^error: .*{image}"):
        main(
            ["predict", str(tmp_path / image), "--model", str(constant_model), "--confidence", "0"]
        )


def test_show_draws_as_many_images_as_there_are(tmp_path: Path) -> None:
    camera = Camera.from_field_of_view(299, 299, 95.0)
    mask = np.zeros((299, 299), dtype=bool)
    mask[50:100, 60:160] = True
    shaft = Instrument(ShaftPose(0.0, 0.0, 25.0, 70.0, 30.0), mask, mask)
    with ShardWriter(tmp_path / shard_name(0), 95) as shard:
        for index in range(3):
            rgb = np.full((299, 299, 3), 60 * index, dtype=np.uint8)
            shard.write(Sample(sample_key(index), rgb, (shaft,), camera, {}))
    out = tmp_path / "sheet.jpg"
    main(["show", "dataset", str(tmp_path), "--out", str(out), "--count", "9", "--columns", "2"])
    sheet = cv2.imread(str(out))
    assert sheet.shape[0] >= 2 * 299
    assert sheet.shape[1] >= 2 * 299
    assert np.ptp(sheet) > 100
