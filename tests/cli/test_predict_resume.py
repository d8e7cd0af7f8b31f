"""`shaftpose predict --resume`, and how a run ends."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.cli import predict
from shaftpose.cli.main import main
from shaftpose.export.onnx_export import store_metadata
from shaftpose.frame_sources.video_files import VideoFile
from shaftpose.inference.model_files import ModelMetadata
from tests.frame_sources.videos import write_video
from tests.inference.full_disk import longest_file

PREDICT = [sys.executable, "-c", "from shaftpose.cli.main import main; main()", "predict"]
PATIENCE_S = 120.0

Run = Callable[..., dict[str, bytes]]


@pytest.fixture
def model(constant_model: Path) -> Path:
    store_metadata(constant_model, ModelMetadata(0.5, 95.0, 3.0))
    return constant_model


@pytest.fixture
def inputs(tmp_path: Path) -> list[str]:
    """A folder of frames, a film, and a photo with the film's name."""
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in range(3):
        pixels = np.full((300, 400, 3), 50 * number + 60, dtype=np.uint8)
        cv2.imwrite(str(folder / f"{number}.png"), pixels)
    shutil.copy(folder / "0.png", tmp_path / "clip.png")
    film = write_video(tmp_path / "clip.avi", [40, 80, 120, 160], 400, 300)
    return [str(folder), str(film), str(tmp_path / "clip.png")]


@pytest.fixture
def run(model: Path, inputs: list[str], tmp_path: Path) -> Run:
    """Predicts into a folder and returns the files there, without the record of options."""

    def predict(*options: str) -> dict[str, bytes]:
        out = tmp_path / "out"
        arguments = ["--model", str(model), "--view-deg", "95", "--out", str(out)]
        main(["predict", *inputs, *arguments, *options])
        files = (path for path in out.iterdir() if path.suffix != ".options")
        return {path.name: path.read_bytes() for path in files}

    return predict


@pytest.mark.parametrize("options", [(), ("--format", "csv"), ("--track",)])
def test_a_resumed_run_ends_like_an_uninterrupted_one(
    options: tuple[str, ...], run: Run, tmp_path: Path
) -> None:
    (whole,) = run(*options).items()
    path = tmp_path / "out" / whole[0]
    for size in range(0, len(whole[1]) + 1, 97):
        path.write_bytes(whole[1][:size])
        assert run("--resume", *options) == dict([whole])


@pytest.mark.parametrize("options", [(), ("--track",)])
def test_drawings_of_a_resumed_run_are_those_of_an_uninterrupted_one(
    options: tuple[str, ...], run: Run, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    whole = run("--draw", *options)
    assert whole.keys() == {"predictions.jsonl", "0.jpg", "1.jpg", "2.jpg", "clip.jpg", "clip.mp4"}
    assert run("--draw", "--resume", *options) == whole
    lines = whole["predictions.jsonl"].splitlines(keepends=True)
    # Killed while the second image was drawn, and while the fourth frame's result was written.
    photos = {"0.jpg": None, "1.jpg": None, "2.jpg": None}
    for count, there in ((2, {"0.jpg": None, "1.jpg": 99}), (6, photos | {"clip.mp4": 999})):
        for name in whole:
            (out / name).unlink()
        for name, size in there.items():
            (out / name).write_bytes(whole[name][:size])
        (out / "predictions.jsonl").write_bytes(b"".join([*lines[:count], lines[count][:9]]))
        assert run("--draw", "--resume", *options) == whole


def test_what_is_done_is_not_read_again(run: Run, inputs: list[str]) -> None:
    whole = run()
    (Path(inputs[0]) / "0.png").write_bytes(b"damaged since")
    assert run("--resume") == whole


def test_nothing_is_resumed_in_an_empty_folder(run: Run, tmp_path: Path) -> None:
    whole = run()
    shutil.rmtree(tmp_path / "out")
    assert run("--resume") == whole


@pytest.mark.parametrize("content", ['{"image": "a"}\n', "no results\n", "[]\n"])
def test_other_files_are_not_continued(content: str, run: Run, tmp_path: Path) -> None:
    run()
    path = tmp_path / "out" / "predictions.jsonl"
    path.write_text(content)
    with pytest.raises(SystemExit, match=f"^error: {path}: holds no results of --format jsonl"):
        run("--resume")
    assert path.read_text() == content


def test_a_run_goes_on_with_its_own_options_alone(
    run: Run, inputs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run("--score", "0.3")
    path = tmp_path / "out" / "predictions.jsonl"
    said = f"^error: {path}: was begun with --score 0.3, not 0.8; give the same again, or name"
    with pytest.raises(SystemExit, match=said):
        run("--resume", "--score", "0.8")
    inputs.reverse()
    with pytest.raises(SystemExit, match=f"^error: {path}: was begun with the sources "):
        run("--resume", "--score", "0.3")
    inputs.reverse()
    with monkeypatch.context() as patch:
        patch.setattr(predict, "versions", lambda backend: (("shaftpose", "newer"),))
        with pytest.raises(SystemExit, match=f"^error: {path}: was begun with the software shaft"):
            run("--resume", "--score", "0.3")
    (tmp_path / "out/predictions.jsonl.options").unlink()
    with pytest.raises(
        SystemExit, match="which tells its options, is missing; name another folder"
    ):
        run("--resume", "--score", "0.3")
    assert path.read_bytes() == whole["predictions.jsonl"]


def test_a_film_beside_its_drawing_is_never_overwritten(model: Path, tmp_path: Path) -> None:
    film = write_video(tmp_path / "clip.mp4", [40, 80, 120, 160], 400, 300)
    arguments = [
        "predict", str(film), "--model", str(model), "--out", str(tmp_path), "--draw", "--resume",
    ]  # fmt: skip
    before = film.read_bytes()
    main(arguments)
    drawn = (tmp_path / "clip-2.mp4").read_bytes()
    (tmp_path / "clip-2.mp4").write_bytes(drawn[:999])  # a killed run leaves it without its end
    main(arguments)
    assert film.read_bytes() == before
    assert (tmp_path / "clip-2.mp4").read_bytes() == drawn


def test_drawings_do_not_join_the_images(run: Run, inputs: list[str], model: Path) -> None:
    folder, model = inputs[0], str(model)
    with pytest.raises(
        SystemExit, match="holds the images to predict, and would hold drawings, too"
    ):
        main(["predict", folder, "--model", model, "--out", folder, "--draw"])
    assert len(list(Path(folder).iterdir())) == 3


@pytest.mark.parametrize(
    ("source", "options", "said"),
    [("0", [], "0 is live and cannot be continued"),
     ("rtsp://host/live", ["--draw"], "rtsp://host/live is live and cannot be continued"),
     ("a.png", ["--draw", "--format", "csv"], "with --draw, needs --format jsonl")],
)  # fmt: skip
def test_what_nobody_can_continue_is_refused(
    source: str, options: list[str], said: str, tmp_path: Path
) -> None:
    with pytest.raises(SystemExit, match=f"^error: --resume: {said}"):
        main(["predict", source, "--resume", "--out", str(tmp_path / "x"), *options])


@pytest.mark.parametrize("options", [["--resume"], ["--resume", "--out", "x", "--format", "bop"]])
def test_what_cannot_be_resumed_is_named(options: list[str]) -> None:
    with pytest.raises(SystemExit, match="^error: --resume: needs --out, and continues no --rerun"):
        main(["predict", "a.png", *options])


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_leaves_whole_files(sent: int, model: Path, tmp_path: Path) -> None:
    film = write_video(tmp_path / "clip.avi", [90] * 4000, 400, 300)
    out = tmp_path / "out"
    with subprocess.Popen(
        [*PREDICT, str(film), "--model", str(model), "--out", str(out), "--draw"],
        stderr=subprocess.PIPE, text=True,
    ) as running:  # fmt: skip
        end = time.monotonic() + PATIENCE_S
        results = out / "predictions.jsonl"
        # A frame is drawn after its result is written: after the third one, there are two.
        while not results.exists() or results.read_bytes().count(b"\n") < 3:
            assert time.monotonic() < end
            time.sleep(0.05)
        running.send_signal(sent)
        said = running.communicate(timeout=PATIENCE_S)[1]
    assert running.returncode == 130
    assert "Traceback" not in said
    drawn = len(list(VideoFile(out / "clip.mp4").frames()))
    lines = (out / "predictions.jsonl").read_text().splitlines()
    assert 0 < drawn <= len(lines) <= drawn + 1 < 4000


def test_a_full_disk_is_one_line(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "out" / "predictions.jsonl"
    with pytest.raises(SystemExit, match=f"^error: {path}: cannot be written"), longest_file(1500):
        run()
    assert path.stat().st_size == 1500


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
@pytest.mark.parametrize(
    ("output", "said"),
    [(">/dev/full", "standard output: cannot be written"), (">&-", "standard output is closed")],
)
def test_output_that_cannot_be_written_is_one_line(
    output: str, said: str, model: Path, inputs: list[str]
) -> None:
    command = [*PREDICT, *inputs, "--model", str(model), "--view-deg", "95", "--diameter-mm", "3"]
    done = subprocess.run(
        ["sh", "-c", f'"$@" {output}', "sh", *command], capture_output=True, text=True
    )
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: {said}")
    assert done.returncode == 1


def test_warnings_never_become_results(model: Path, inputs: list[str]) -> None:
    command = [*PREDICT, *inputs, "--model", str(model)]
    done = subprocess.run(["sh", "-c", '"$@" 2>&-', "sh", *command], capture_output=True, text=True)
    assert done.returncode == 0
    assert all(line.startswith('{"image"') for line in done.stdout.splitlines())
