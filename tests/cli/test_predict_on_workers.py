"""`shaftpose predict --workers` with real processes."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.cli.main import main
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.model_files import ModelMetadata

CHUNK, IMAGES = 16, 40


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
        (file,) = out.iterdir()
        written.append(file.read_bytes())
    assert written[0] == written[1]
    assert f"error: {bad}: " in said[0]
    assert said[0] == said[1]


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
