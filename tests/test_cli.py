"""The command line."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.cli import main
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import write_jpeg
from shaftpose.core.shards import Instrument, Sample, ShardWriter, sample_key, shard_name
from shaftpose.deployment import bundled
from shaftpose.deployment.model_facts import ModelFacts
from shaftpose.deployment.onnx_export import store_facts

Places = list[tuple[int, int]]

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
    store_facts(constant_model, ModelFacts(0.5, 95.0, 3.0))
    main(["predict", str(frame), str(frame), "--model", str(constant_model)])
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert lines == [{"image": str(frame), "instruments": [FIRST]}] * 2


def test_predict_needs_no_model_file(
    constant_model: Path,
    frame: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    store_facts(constant_model, ModelFacts(0.5, 95.0, 3.0))
    monkeypatch.setattr(bundled, "FOLDER", constant_model.parent)
    model = constant_model.rename(constant_model.with_name(bundled.MODEL))
    model.with_name(bundled.CHECKSUM).write_bytes(bundled.checksum(model))
    main(["predict", str(frame)])
    assert json.loads(capsys.readouterr().out)["instruments"] == [FIRST]
    model.unlink()
    with pytest.raises(SystemExit, match=rf"^error: {model}: missing; reinstall the package.*$"):
        main(["predict", str(frame)])


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
        store_facts(constant_model, ModelFacts(0.5, view_deg, 3.0))
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


def lightness(path: Path) -> NDArray[np.uint8]:
    """(H, W) of a picture, whose JPEG leaves little of a thin line's colour."""
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def assert_drawn(picture: NDArray[np.uint8], light: Places, dark: Places) -> None:
    """That of a black image the places (row, column) `light` are drawn on, and `dark` are not."""
    assert min(picture[place] for place in light) > 60
    assert max(picture[place] for place in dark) < 40


def test_show_draws_as_many_images_as_there_are(tmp_path: Path) -> None:
    camera = Camera.from_field_of_view(299, 299, 95.0)
    mask = np.zeros((299, 299), dtype=bool)
    mask[60:90, 80:140] = True
    mask[50:100, 100:102] = mask[84:86, 60:160] = True  # thin bars, so that the box is larger
    # From the centre to the right.
    shaft = Instrument(ShaftPose(0.0, 0.0, 20.0, 90.0, 0.0), mask, mask)
    rgb = np.zeros((299, 299, 3), dtype=np.uint8)
    with ShardWriter(tmp_path / shard_name(0), 95) as shard:
        for index in range(3):
            shard.write(Sample(sample_key(index), rgb, (shaft,), camera, {}))
    out = tmp_path / "sheet.jpg"
    main(["show", "dataset", str(tmp_path), "--out", str(out), "--count", "9", "--columns", "2"])
    sheet = lightness(out)
    assert sheet.shape == (2 * 299, 2 * 299)
    for row, column in ((0, 0), (0, 299), (299, 0)):
        image = sheet[row : row + 299, column : column + 299]
        box_mask_axis = [(50, 70), (75, 159), (60, 110), (75, 80), (149, 200)]
        assert_drawn(image, box_mask_axis, [(75, 110), (149, 100), (200, 200)])
        assert np.max(image[280:299, 4:200]) > 100  # the pose in figures
    assert sheet[305:, 305:].max() < 40


def test_show_draws_real_images(tmp_path: Path) -> None:
    """Two of different sizes: of 400 x 300 the square begins at column 50, 600 x 600 is halved."""
    content = {
        "train": (400, 300, {"bbox": [100, 100, 100, 50]}),
        "test": (600, 600, {"bbox": [100, 100, 400, 400],
                            "segmentation": [[200, 200, 400, 200, 400, 400, 200, 400]]}),
    }  # fmt: skip
    for name, (width, height, shaft) in content.items():
        file = f"images/{name}.jpg"
        write_jpeg(np.zeros((height, width, 3), dtype=np.uint8), tmp_path / file)
        image = {"id": 1, "file_name": file, "width": width, "height": height}
        listed = {"images": [image], "annotations": [{"image_id": 1, **shaft}]}
        (tmp_path / f"{name}.json").write_text(json.dumps(listed))
    (tmp_path / "about.json").write_text("{}")
    out = tmp_path / "sheet.jpg"
    main(["show", "dataset", str(tmp_path), "--out", str(out)])
    sheet = lightness(out)
    assert sheet.shape == (300, 5 * 300)
    train, test = sheet[:, :300], sheet[:, 300:600]
    assert_drawn(train, [(100, 80), (149, 80), (120, 50), (120, 149)], [(120, 100), (200, 200)])
    # Its box is the extent of its mask, whatever the file says.
    outline = [(100, 150), (199, 150), (150, 100), (150, 199)]
    assert_drawn(test, outline, [(150, 150), (50, 150), (75, 75), (20, 20)])


def test_show_names_a_folder_without_a_dataset(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=rf"^error: {tmp_path}: no shard"):
        main(["show", "dataset", str(tmp_path), "--out", str(tmp_path / "sheet.jpg")])
