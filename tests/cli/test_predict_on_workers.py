"""`shaftpose predict --workers` with real processes."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil
import pytest

from shaftpose.cli.main import main
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.model_files import ModelMetadata

CHUNK, IMAGES = 16, 40
PATIENCE_S = 300.0  # enough for a busy machine

PREDICT = """
import signal
import sys
from shaftpose.cli.main import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's `&` takes it away
main(sys.argv[1:])
"""


@pytest.fixture
def model(constant_model: Path) -> Path:
    store_metadata(constant_model, ModelMetadata(0.5, 95.0, 3.0))
    return constant_model


@pytest.fixture
def images(tmp_path: Path) -> Path:
    """A folder of images of different sizes."""
    folder = tmp_path / "images"
    folder.mkdir()
    for number in range(IMAGES):
        pixels = np.full((100, 100 + number, 3), 90, dtype=np.uint8)
        cv2.imwrite(str(folder / f"{number:06}.png"), pixels)
    return folder


def arguments(images: Path, model: Path, out: Path) -> list[str]:
    """Of a prediction by two workers."""
    return ["predict", str(images), "--model", str(model), "--out", str(out), "--workers", "2"]


def wait_until(condition: Callable[[], Any]) -> Any:
    """The value of the condition once it holds."""
    end = time.monotonic() + PATIENCE_S
    while not (result := condition()):
        assert time.monotonic() < end, "it never came about"
        time.sleep(0.05)
    return result


def lines(out: Path) -> list[str]:
    """The results so far."""
    path = out / "predictions.jsonl"
    return path.read_text().splitlines(keepends=True) if path.exists() else []


@pytest.mark.parametrize("style", ["jsonl", "bop"])
def test_results_are_those_of_one_process_and_a_bad_image_is_named(
    style: str, images: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = images / ("000020.png" if style == "jsonl" else "unnumbered.png")
    bad.write_bytes(b"no image" if style == "jsonl" else (images / "000000.png").read_bytes())
    said, written = [], []
    for out, extra in ((tmp_path / "alone", []), (tmp_path / "spread", ["--workers", "2"])):
        with pytest.raises(SystemExit, match="^error: sources that failed, see above: 1$"):
            main(["predict", str(images), "--model", str(model), "--out", str(out),
                  "--format", style, *extra])  # fmt: skip
        said.append(capsys.readouterr().err)
        (file,) = (path for path in out.iterdir() if path.suffix != ".options")
        written.append(file.read_bytes())
    assert written[0] == written[1]
    assert f"error: {bad}: " in said[0]
    assert said[0] == said[1]


@contextmanager
def predicting(model: Path, out: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A prediction of what standard input names, in a process group of its own, which does not
    outlive the test."""
    command = [sys.executable, "-c", PREDICT, *arguments(Path("-"), model, out)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    ) as running:
        try:
            yield running
        finally:
            if running.poll() is None:
                os.killpg(running.pid, signal.SIGKILL)


def name(running: subprocess.Popen[bytes], images: Sequence[Path]) -> None:
    """Write the names of images to a prediction."""
    assert running.stdin
    running.stdin.write("".join(f"{image}\n" for image in images).encode())
    running.stdin.flush()


def name_until_results(
    running: subprocess.Popen[bytes], images: Sequence[Path], out: Path
) -> list[Path]:
    """Name a chunk of images again and again until the first are predicted, since results are
    written when a chunk arrives. Returns all that were named."""
    named: list[Path] = []

    def results() -> list[str]:
        name(running, images[:CHUNK])
        named.extend(images[:CHUNK])
        time.sleep(0.5)
        return lines(out)

    wait_until(results)
    return named


def test_images_of_a_killed_worker_are_predicted_by_another(
    images: Path, model: Path, tmp_path: Path
) -> None:
    """Both workers are killed while they are suspended, with the last images to do."""
    paths, out = sorted(images.iterdir()), tmp_path / "out"
    main(arguments(images, model, tmp_path / "undisturbed")[:-2])
    undisturbed = dict(zip(paths, lines(tmp_path / "undisturbed"), strict=True))
    with predicting(model, out) as running:
        named = [*name_until_results(running, paths, out), *paths]
        workers = [
            process
            for process in psutil.Process(running.pid).children(recursive=True)
            if "spawn_main" in " ".join(process.cmdline())
        ]
        for process in workers:
            process.suspend()
        name(running, paths)
        for process in workers:
            process.kill()
        running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 0
    assert lines(out) == [undisturbed[image] for image in named]


def test_ctrl_c_keeps_complete_results_and_ends_all_processes(
    images: Path, model: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    with predicting(model, out) as running:
        name_until_results(running, sorted(images.iterdir()), out)
        processes = psutil.Process(running.pid).children(recursive=True)
        os.killpg(running.pid, signal.SIGINT)  # as a terminal does
        said = wait_until(lambda: running.poll() is not None) and running.stderr
        assert said and b"Traceback" not in said.read()
    assert running.returncode == 130
    assert len(lines(out)) % CHUNK == 0 and lines(out)[-1].endswith("}\n")
    wait_until(lambda: not any(process.is_running() for process in processes))


def test_a_scheduler_that_does_not_answer_leaves_no_wait(
    images: Path, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shaftpose.farm.workers._ANSWER_S", 0.2)
    command = [*arguments(images, model, tmp_path / "out")[:-1], "tcp://127.0.0.1:9"]
    with pytest.raises(SystemExit, match=r"^error: tcp://127\.0\.0\.1:9: no Dask scheduler"):
        main(command)
    assert not (tmp_path / "out").exists()  # or the next try would find earlier results


def test_a_scheduler_is_given_no_model_of_a_registry(images: Path, tmp_path: Path) -> None:
    command = arguments(images, Path("mlflow:/shaftpose@champion"), tmp_path / "out")[:-1]
    with pytest.raises(SystemExit, match=r"^error: --model mlflow:/shaftpose@champion: not with"):
        main([*command, "tcp://127.0.0.1:9"])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("option", ["--draw", "--rerun", "--track"])
def test_workers_write_nothing_but_results(
    option: str, images: Path, model: Path, tmp_path: Path
) -> None:
    with pytest.raises(SystemExit, match="^error: --draw, --rerun, --track: not with --workers"):
        main([*arguments(images, model, tmp_path / "out"), option])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("workers", ["0", "some"])
def test_workers_are_a_number_or_an_address(workers: str, images: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["predict", str(images), "--workers", workers])
    assert ended.value.code == 2
