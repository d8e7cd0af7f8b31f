"""The command line."""

import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.cli.main import main
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import write_jpeg
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter, shard_name
from shaftpose.export.onnx_export import store_metadata
from shaftpose.frame_sources.video_files import VideoFile
from shaftpose.inference import model_files
from shaftpose.inference.model_files import ModelMetadata
from tests.frame_sources.videos import read_greys, with_pixel_aspect, write_video
from tests.image_files.made_files import jpeg_with_exif
from tests.inference.test_calibration_files import PINHOLE

Places = list[tuple[int, int]]

FIRST = {
    # Of a frame of 400 x 300 px: 300 / 299 of the model's pixels, from column 50.
    "score": 0.75, "box": [60.0, 20.1, 160.4, 220.7],
    "tip_px": [206.9, 136.3], "axis_px": [[206.9, 136.3], [165.9, 198.8]],
    "x_mm": 1.0, "y_mm": -2.0, "z_mm": 20.0, "pitch_deg": 70.0, "yaw_deg": 123.0, "metric": False,
    "tip": "seen", "deviations": None, "track": None,
}  # fmt: skip
CAMERA = """%YAML:1.0
---
image_width: 400
image_height: 300
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 100., 0., 219.5, 0., 100., 149.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ 0., 0., 0., 0. ]
"""


@pytest.fixture
def frame(tmp_path: Path) -> Path:
    path = tmp_path / "frame.png"
    cv2.imwrite(str(path), np.full((300, 400, 3), 90, dtype=np.uint8))
    return path


@pytest.fixture
def model(constant_model: Path) -> Path:
    """The model with a threshold that only the first of its two shafts reaches."""
    store_metadata(constant_model, ModelMetadata(0.5, 95.0, 3.0))
    return constant_model


def results(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def test_predict_prints_what_reaches_the_models_confidence(
    model: Path, frame: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["predict", str(frame), str(frame), "--model", str(model)])
    expected = {"image": str(frame), "frame": 0, "time_s": None, "instruments": [FIRST]}
    assert results(capsys.readouterr().out) == [expected] * 2


def test_predict_needs_no_model_file(
    model: Path,
    frame: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(model_files, "FOLDER", model.parent)
    model = model.rename(model.with_name("shaftpose.onnx"))
    model.with_name("shaftpose.onnx.sha256").write_bytes(model_files.checksum(model))
    main(["predict", str(frame)])
    assert json.loads(capsys.readouterr().out)["instruments"] == [FIRST]
    model.unlink()
    with pytest.raises(SystemExit, match=rf"^error: {model}: missing; reinstall the package.*$"):
        main(["predict", str(frame)])


def test_the_users_score_goes_first(
    model: Path, frame: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    counts = []
    for score in ("0", "0.3", "0.8"):
        main(["predict", str(frame), "--model", str(model), "--score", score])
        counts.append(len(json.loads(capsys.readouterr().out)["instruments"]))
    assert counts == [2, 1, 0]


@pytest.mark.parametrize(
    ("options", "missing", "metric"),
    [
        ([], ["--camera or --view-deg", "--diameter-mm"], False),
        (["--view-deg", "95"], ["--diameter-mm"], False),
        (["--diameter-mm", "3"], ["--camera or --view-deg"], False),
        (["--view-deg", "95", "--diameter-mm", "3"], [], True),
    ],
)
def test_millimetres_are_metric_if_camera_and_shaft_are_stated(
    options: list[str],
    missing: list[str],
    metric: bool,
    model: Path,
    frame: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    main(["predict", str(frame), str(frame), "--model", str(model), *options])
    printed = capsys.readouterr()
    found = [one for line in results(printed.out) for one in line["instruments"]]
    assert [one["metric"] for one in found] == [metric] * 2
    assert printed.err.count("NOT METRIC") == (not metric)
    for option in ("--camera or --view-deg", "--diameter-mm"):
        assert (f"state yours ({option})." in printed.err) == (option in missing)


def test_positions_grow_with_the_diameter_and_pixels_do_not(
    model: Path, frame: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["predict", str(frame), "--model", str(model), "--diameter-mm", "7.5"])
    (found,) = json.loads(capsys.readouterr().out)["instruments"]
    assert [found[name] for name in ("x_mm", "y_mm", "z_mm")] == [2.5, -5, 50]
    for name in ("box", "tip_px", "pitch_deg", "yaw_deg"):
        assert found[name] == FIRST[name]


def test_a_model_without_a_diameter_converts_none(
    model: Path, frame: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store_metadata(model, ModelMetadata(0.5, 95.0))
    arguments = ["predict", str(frame), "--model", str(model), "--view-deg", "95"]
    main(arguments)
    assert json.loads(capsys.readouterr().out)["instruments"][0]["metric"]
    with pytest.raises(SystemExit, match="^error: --diameter-mm 5: the model states no diameter"):
        main([*arguments, "--diameter-mm", "5"])


def test_pixels_are_those_of_the_users_camera(
    model: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tip is the ray (1 / 20, -2 / 20), seen with a focal length of 100 px from (220, 150)."""
    camera = tmp_path / "cam.yaml"
    camera.write_text(CAMERA)
    main(["predict", str(frame), "--model", str(model), "--camera", str(camera)])
    (found,) = json.loads(capsys.readouterr().out)["instruments"]
    assert found["tip_px"] == [225.0, 140.0]
    # 90 deg: a focal length of 150 px from (200, 150).
    main(["predict", str(frame), "--model", str(model), "--view-deg", "90"])
    (found,) = json.loads(capsys.readouterr().out)["instruments"]
    assert found["tip_px"] == [207.5, 135.0]


def test_a_frame_of_another_size_than_the_calibration_is_an_error(
    model: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    camera, other = tmp_path / "cam.yaml", tmp_path / "other.png"
    camera.write_text(CAMERA)
    cv2.imwrite(str(other), np.zeros((300, 300, 3), dtype=np.uint8))
    arguments = ["--model", str(model), "--camera", str(camera)]
    with pytest.raises(SystemExit, match="^error: sources that failed, see above: 1$"):
        main(["predict", str(other), str(frame), *arguments])
    printed = capsys.readouterr()
    assert f"error: {other}: has 300 x 300 px, but {camera} is the calibration" in printed.err
    assert [line["image"] for line in results(printed.out)] == [str(frame)]


def test_a_camera_is_stated_once(model: Path, frame: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["predict", str(frame), "--camera", "cam.yaml", "--view-deg", "95"])
    assert ended.value.code == 2


@pytest.mark.parametrize("time", ["-1", "a", "1:2:3:4", "inf", ""])
def test_a_time_is_a_number_or_a_clocks(time: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["predict", "film.mp4", f"--start={time}"])
    assert f"{time} is no time, such as 90.5 or 1:30.5" in capsys.readouterr().err


def test_a_part_of_a_film_is_predicted(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film = write_video(tmp_path / "clip.avi", [90] * 20, 400, 300)
    arguments = ["--start", "0:0.5", "--end", "1.5", "--every", "4"]
    main(["predict", str(film), "--model", str(model), *arguments])
    assert [line["frame"] for line in results(capsys.readouterr().out)] == [8, 12]
    with pytest.raises(SystemExit, match="^error: --start 3 s is not before --end 2 s"):
        main(["predict", str(film), "--model", str(model), "--start", "3", "--end", "2"])


@pytest.mark.parametrize("crop", ["1,2,3", "a,b,c,d"])
def test_a_part_is_four_numbers(crop: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["predict", "frame.png", "--crop", crop])
    assert f"{crop} is not X,Y,W,H, four whole numbers" in capsys.readouterr().err


def test_results_and_pictures_go_into_a_folder(
    model: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "found"
    main(["predict", str(frame), "--model", str(model), "--out", str(out), "--draw"])
    (line,) = results((out / "predictions.jsonl").read_text())
    assert line["instruments"] == [FIRST]
    drawn = cv2.imread(str(out / "frame.jpg"))
    assert drawn.shape == (300, 400, 3)
    assert np.ptp(drawn) > 100  # the frame alone is of one grey
    assert capsys.readouterr().out == f"results are in {out}\n"


def test_a_video_is_predicted_and_drawn_frame_by_frame(model: Path, tmp_path: Path) -> None:
    video, out = write_video(tmp_path / "clip.avi", [40, 120, 200], 400, 300), tmp_path / "found"
    main(["predict", str(video), "--model", str(model), "--out", str(out), "--draw"])
    lines = results((out / "predictions.jsonl").read_text())
    expected = [
        {"image": str(video), "frame": n, "time_s": n / 10, "instruments": [FIRST]}
        for n in range(3)
    ]
    assert lines == expected
    drawn = read_greys(out / "clip.mp4")
    assert drawn == pytest.approx([40, 120, 200], abs=12)
    assert drawn != pytest.approx([40, 120, 200], abs=0.5)


def test_oblong_pixels_change_no_pose(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """300 px of 4 : 3 are as wide as 400 square ones, whose central 300 are 225 px from 37 on."""
    video = with_pixel_aspect(write_video(tmp_path / "clip.mp4", [90], 300, 300), 4, 3)
    main(["predict", str(video), "--model", str(model)])
    (found,) = json.loads(capsys.readouterr().out)["instruments"]
    for name in ("score", "x_mm", "y_mm", "z_mm", "pitch_deg", "yaw_deg"):
        assert found[name] == FIRST[name]
    assert found["tip_px"] == pytest.approx([37 + (206.9 - 50) * 3 / 4, 136.3], abs=0.06)


def test_a_photo_is_upright_whatever_its_name_says(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, pixels = tmp_path / "photos", np.full((400, 300, 3), 90, dtype=np.uint8)
    folder.mkdir()
    for name in ("f10.jfif", "f9.jpg", "._f9.jpg", "f9.jpg.part"):
        (folder / name).write_bytes(jpeg_with_exif(pixels, 6))
    arguments = ["--model", str(model)]
    main(["predict", str(folder), str(folder / "f10.jfif"), *arguments])
    found = results(capsys.readouterr().out)
    names = [str(folder / name) for name in ("f9.jpg", "f10.jfif", "f10.jfif")]
    assert [line["image"] for line in found] == names
    assert all(line["instruments"] == [FIRST] for line in found)


def test_a_word_about_unused_bits_is_said_once(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(3):
        pixels = np.full((300, 400), 4000, dtype=np.uint16)
        cv2.imwrite(str(tmp_path / f"{number}.png"), pixels)
    main(["predict", str(tmp_path), "--model", str(model), "--view-deg", "95"])
    assert capsys.readouterr().err.count("uses 12 of its 16 bits") == 1


@pytest.mark.parametrize(("name", "suffix"), [("csv", "csv"), ("bop", "csv")])
def test_tables_have_a_heading_and_a_line_for_each_shaft(
    name: str, suffix: str, model: Path, frame: Path, tmp_path: Path
) -> None:
    numbered, out = frame.rename(tmp_path / "000007.png"), tmp_path / "found"
    arguments = ["--score", "0", "--format", name, "--out", str(out)]
    main(["predict", str(numbered), "--model", str(model), *arguments])
    heading, *lines = (out / f"predictions.{suffix}").read_text().splitlines()
    assert len(lines) == 2
    assert {line.count(",") for line in lines} == {heading.count(",")}


def test_earlier_results_are_kept(model: Path, frame: Path, tmp_path: Path) -> None:
    (tmp_path / "predictions.jsonl").write_text("earlier")
    with pytest.raises(
        SystemExit,
        match=r"^error: .*predictions.jsonl: is there already, and is kept; name another folder",
    ):
        main(["predict", str(frame), "--model", str(model), "--out", str(tmp_path)])
    assert (tmp_path / "predictions.jsonl").read_text() == "earlier"


@pytest.mark.parametrize("kind", ["pipe", "device", "link"])
def test_what_is_no_file_is_named_and_skipped(
    kind: str, model: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.png"
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero" if kind == "device" else path)
    film = tmp_path / "film"
    film.symlink_to(path)
    with pytest.raises(SystemExit, match="^error: sources that failed, see above: 2$"):
        main(["predict", str(tmp_path), str(film), "--model", str(model)])
    printed = capsys.readouterr()
    assert [line["image"] for line in results(printed.out)] == [str(frame)]
    assert f"error: {path}: cannot be read" in printed.err and f"error: {film}: " in printed.err


def test_names_do_not_command_the_terminal(
    model: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    named = frame.rename(tmp_path / "\x1b[31mred.png")
    (tmp_path / "\x1b[2Jbad.png").write_text("no image")
    with pytest.raises(SystemExit):
        main(["predict", str(tmp_path), "--model", str(model), "--format", "csv"])
    printed = capsys.readouterr()
    assert str(named) in printed.out  # into a file or a pipe, names go as they are
    assert r"\x1b[2Jbad.png: not a readable image" in printed.err and "\x1b" not in printed.err


def test_no_image_is_overwritten_by_a_drawing(model: Path, frame: Path, tmp_path: Path) -> None:
    photo = tmp_path / "frame.jpg"
    cv2.imwrite(str(photo), cv2.imread(str(frame)))
    before = photo.read_bytes()
    main(["predict", str(photo), "--model", str(model), "--out", str(tmp_path), "--draw"])
    assert photo.read_bytes() == before
    assert (tmp_path / "frame-2.jpg").is_file()


def test_drawing_needs_a_folder(frame: Path) -> None:
    with pytest.raises(SystemExit, match="^error: --draw: needs a folder"):
        main(["predict", str(frame), "--draw"])


def test_names_come_from_standard_input(
    model: Path, frame: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{frame}\n{frame}\n"))
    main(["predict", "-", "--model", str(model)])
    assert [line["image"] for line in results(capsys.readouterr().out)] == [str(frame)] * 2


def test_names_that_are_not_utf_8_are_written_as_they_are(
    model: Path, frame: Path, tmp_path: Path
) -> None:
    named = frame.rename(tmp_path / "caf\udce9.png")
    main(["predict", str(named), "--model", str(model), "--format", "csv", "--out", str(tmp_path)])
    assert b"caf\xe9.png,0,,0.75" in (tmp_path / "predictions.csv").read_bytes()


def test_names_on_standard_input_need_not_be_utf_8(
    model: Path, frame: Path, tmp_path: Path
) -> None:
    frame.rename(tmp_path / "caf\udce9.png")
    command = [sys.executable, "-c", "from shaftpose.cli.main import main; main()", "predict", "-"]
    done = subprocess.run(
        [*command, "--model", str(model), "--format", "csv"],
        input=b"caf\xe9.png\n", cwd=tmp_path, capture_output=True, check=True,
        env={**os.environ, "PYTHONIOENCODING": "utf-8:strict"},
    )  # fmt: skip
    assert b"caf\xe9.png,0,,0.75" in done.stdout


def test_standard_input_is_left_alone_unless_named(
    model: Path, frame: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python refuses to change what has been read from."""
    read = io.TextIOWrapper(io.BytesIO(b"one\ntwo\n"), encoding="utf-8")
    read.readline()
    monkeypatch.setattr("sys.stdin", read)
    main(["predict", str(frame), "--model", str(model)])
    assert read.readline() == "two\n"


def test_unreadable_images_are_reported_and_the_rest_goes_on(
    model: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ("missing.png", "text.png", "empty.png", "cut.png", "long.png")
    bad = {name: tmp_path / name for name in names}
    bad["text.png"].write_text("no image")
    bad["empty.png"].touch()
    bad["cut.png"].write_bytes(frame.read_bytes()[:40])
    cv2.imwrite(str(bad["long.png"]), np.zeros((2, 70_000, 3), dtype=np.uint8))
    with pytest.raises(SystemExit, match="^error: sources that failed, see above: 5$"):
        main(["predict", *map(str, bad.values()), str(frame), "--model", str(model)])
    printed = capsys.readouterr()
    assert [line["image"] for line in results(printed.out)] == [str(frame)]
    for path in bad.values():
        assert f"error: {path}: " in printed.err


@pytest.mark.parametrize(
    "pixels",
    [
        np.full((300, 400), 90, dtype=np.uint8),
        np.full((300, 400, 4), 90, dtype=np.uint8),
        np.full((300, 400, 3), 23130, dtype=np.uint16),
        np.full((1, 1, 3), 90, dtype=np.uint8),
        np.full((2, 5000, 3), 90, dtype=np.uint8),
    ],
    ids=["grey", "alpha", "16-bit", "one pixel", "long"],
)
def test_images_of_all_kinds_are_predicted(
    pixels: NDArray[Any], model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "frame.png", tmp_path / "found"
    cv2.imwrite(str(path), pixels)
    arguments = ["--model", str(model), "--view-deg", "95", "--out", str(out), "--draw"]
    main(["predict", str(path), *arguments])
    (line,) = results((out / "predictions.jsonl").read_text())
    assert len(line["instruments"]) == 1


def test_a_reader_who_has_enough_ends_the_command_quietly(model: Path, frame: Path) -> None:
    code = "import sys; from shaftpose.cli.main import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", code, "predict", "-", "--model", str(model)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stdin and running.stdout and running.stderr
        running.stdin.write(f"{frame}\n")
        running.stdin.flush()
        assert json.loads(running.stdout.readline())["image"] == str(frame)
        running.stdout.close()
        running.stdin.write(f"{frame}\n")
        running.stdin.close()
        said = running.stderr.read()
    assert running.returncode == 1
    assert re.fullmatch("warning: .*NOT METRIC.*\nwarning: .*central square.*\n", said)


def test_a_model_of_a_registry_needs_mlflow(frame: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "shaftpose.tracking.models", None)
    with pytest.raises(SystemExit, match=r"mlflow:/shaftpose@champion: needs MLflow: in a clone"):
        main(["predict", str(frame), "--model", "mlflow:/shaftpose@champion"])


def test_the_demo_finds_the_shafts_of_its_examples(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "look"
    main(["demo", "--out", str(out)])
    image, *film = results((out / "predictions.jsonl").read_text())
    assert [one["metric"] for one in image["instruments"]] == [True, True]
    assert len(film) == 50
    assert all({one["track"] for one in line["instruments"]} == {1, 2} for line in film)
    assert cv2.imread(str(out / "demo_frame.jpg")).shape == (299, 299, 3)
    assert len(list(VideoFile(out / "demo_film.mp4").frames())) == 50
    assert capsys.readouterr().out.startswith("results are in ")


def test_models_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    main(["models"])
    headings, *rows = capsys.readouterr().out.partition("\n\n")[0].splitlines()
    assert headings.startswith("name ")
    assert [row.split()[0] for row in rows] == list(model_files.bundled_names())
    assert rows[-1].split()[1:4] == ["299", "95.0", "3.0"]


def test_models_prints_the_facts_and_the_card_of_one(capsys: pytest.CaptureFixture[str]) -> None:
    main(["models", "shaftpose"])
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) < 500  # no weights
    assert "\nview_deg: 95.0\n" in printed and "\nshaft_diameter_mm: 3.0\n" in printed
    assert printed.startswith("name: shaftpose\n")
    assert (model_files.FOLDER / "shaftpose.md").read_text() in printed


def test_check_says_what_prediction_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # 480 px become 270.
    calibration = tmp_path / "cam.yaml"
    calibration.write_text(PINHOLE)
    main(["check", "--camera", str(calibration)])
    printed = capsys.readouterr().out
    assert "this machine can predict" in printed
    assert "camera: frames of 640 x 480 px (5 coefficients); shaftpose sees them as 360 x 270" in (
        printed
    )
    assert "1.8 px of the frame in one; to train" in printed
    assert "set camera.view_deg to 90.0\n" in printed
    monkeypatch.setitem(sys.modules, "tqdm", None)
    with pytest.raises(SystemExit, match="^error: cannot predict here: packages; see"):
        main(["check"])
    assert "packages: FAILED: import of tqdm halted" in capsys.readouterr().out


def test_check_takes_another_model(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration = tmp_path / "cam.yaml"
    calibration.write_text(PINHOLE)  # of 90 deg
    main(["check", "--camera", str(calibration), "--model", str(model)])
    printed = capsys.readouterr().out
    speed = rf"^model: {re.escape(str(model))}, \d+ images of 299 px per second$"
    assert re.search(speed, printed, re.M)
    assert f"{model} sees them" in printed
    model.write_bytes(b"no model")
    with pytest.raises(SystemExit, match="^error: cannot predict here: model; see"):
        main(["check", "--model", str(model)])
    assert f"model: FAILED: {model}: not a readable ONNX model" in capsys.readouterr().out


def test_check_refuses_a_camera_as_prediction_does(constant_model: Path, tmp_path: Path) -> None:
    store_metadata(constant_model, ModelMetadata(confidence=0.5, distorted=True))
    calibration = tmp_path / "cam.yaml"
    calibration.write_text(PINHOLE)
    with pytest.raises(SystemExit, match=r"^error: .*constant\.onnx: was trained with lens"):
        main(["check", "--camera", str(calibration), "--model", str(constant_model)])


@pytest.mark.parametrize("command", ["demo", "predict", "models", "show", "check"])
def test_help_gives_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    assert f" shaftpose {command}" in capsys.readouterr().out.partition("example")[2]


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--version"])
    assert re.fullmatch(r"shaftpose \d+\.\d+\.\d+\n", capsys.readouterr().out)


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
    """Of different sizes: of 400 x 300 the square begins at column 50, 600 x 600 is halved."""
    content = {
        "train": (400, 300, {"bbox": [100, 100, 100, 50]}),
        "test": (600, 600, {"bbox": [100, 100, 400, 400],
                            "segmentation": [[200, 200, 400, 200, 400, 400, 200, 400]]}),
        "validation": (300, 300, {"bbox": [10, 10, 40, 40]}),
    }  # fmt: skip
    for name, (width, height, shaft) in content.items():
        file = f"images/{name}.jpg"
        write_jpeg(np.zeros((height, width, 3), dtype=np.uint8), tmp_path / file)
        image = {"id": 1, "file_name": file, "width": width, "height": height}
        listed = {"images": [image], "annotations": [{"image_id": 1, **shaft}]}
        (tmp_path / f"{name}.json").write_text(json.dumps(listed))
    (tmp_path / "about.json").write_text("{}")
    out = tmp_path / "sheet.jpg"
    main(["show", "dataset", str(tmp_path), "--out", str(out), "--columns", "20000"])
    sheet = lightness(out)
    assert sheet.shape == (300, 3 * 300)
    train, validation, test = sheet[:, :300], sheet[:, 300:600], sheet[:, 600:]
    assert_drawn(train, [(100, 80), (149, 80), (120, 50), (120, 149)], [(120, 100), (200, 200)])
    # Its box is the extent of its mask, whatever the file says.
    outline = [(100, 150), (199, 150), (150, 100), (150, 199)]
    assert_drawn(test, outline, [(150, 150), (50, 150), (75, 75), (20, 20)])
    assert_drawn(validation, [(10, 30), (30, 10)], [(150, 150)])


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--out", "sheet.png"], "--out sheet.png: name a file that ends in .jpg"),
        (["--out", "/dev/null"], "--out /dev/null: name a file"),
        (["--out", "device.jpg"], "--out device.jpg: name a file"),
        (["--out", "sheet.jpg", "--count", "501"], "--count 501: draw at most 500"),
    ],
)
def test_show_names_what_it_cannot_write(
    options: list[str], complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("device.jpg")
    with pytest.raises(SystemExit, match=f"^error: {complaint}"):
        main(["show", "dataset", str(tmp_path), *options])
    assert [path.name for path in tmp_path.iterdir()] == ["device.jpg"]


def test_show_names_a_folder_without_a_dataset(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=rf"^error: {tmp_path}: no shard"):
        main(["show", "dataset", str(tmp_path), "--out", str(tmp_path / "sheet.jpg")])
