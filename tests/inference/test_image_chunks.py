"""Images in chunks, here predicted by this process."""

import re
import socket
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.export.onnx_export import store_metadata
from shaftpose.frame_sources.frames import ImageFile, Source
from shaftpose.frame_sources.video_files import Span
from shaftpose.inference import image_chunks
from shaftpose.inference.chunk_worker import Chunk, PredictedImage, Prediction
from shaftpose.inference.image_chunks import predicted_images
from shaftpose.inference.loading import FinderOptions
from shaftpose.inference.model_files import ModelMetadata
from shaftpose.inference.prediction_run import sources

Work = Callable[[Chunk], Prediction]
Predicted = Iterator[tuple[Chunk, Prediction | None]]


@pytest.fixture(autouse=True)
def environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a worker has it: the threads of later tests stay as they are."""
    monkeypatch.setenv("ORT_INTRA_OP_NUM_THREADS", "1")


@pytest.fixture
def options(constant_model: Path) -> FinderOptions:
    store_metadata(constant_model, ModelMetadata(0.5, 95.0, 3.0))
    return FinderOptions(str(constant_model), None, 95.0, None, None, None, "edges", "onnxruntime")


@pytest.fixture
def images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Source]:
    """20 images, named from the current folder: two chunks."""
    monkeypatch.chdir(tmp_path)
    for number in range(20):
        cv2.imwrite(f"{number:02}.png", np.full((30, 40, 3), 90, dtype=np.uint8))
    return [ImageFile(Path(f"{number:02}.png")) for number in range(20)]


def here(work: Work, chunks: Iterable[Chunk]) -> Predicted:
    for chunk in chunks:
        yield chunk, work(chunk)


def elsewhere(work: Work, chunks: Iterable[Chunk]) -> Predicted:
    """As processes of another folder."""
    with tempfile.TemporaryDirectory() as folder:
        for chunk in list(chunks):
            with chdir(folder):
                result = work(chunk)
            yield chunk, result


def run(images: list[Source], options: FinderOptions, spread: image_chunks.Spread = here) -> tuple[
    list[PredictedImage], list[str]
]:  # fmt: skip
    """The images, and the warnings."""
    warnings: list[str] = []
    return list(predicted_images(images, options, spread, warnings.append)), warnings


def test_images_are_those_that_were_named(images: list[Source], options: FinderOptions) -> None:
    found, _ = run(images, options, elsewhere)
    assert [image.source for image in found] == [image.name for image in images]
    assert all(len(image.shafts) == 1 and not image.error for image in found)


def test_an_image_that_fails_is_named_and_the_rest_goes_on(
    images: list[Source], options: FinderOptions, tmp_path: Path
) -> None:
    Path("07.png").write_text("no image")
    (tmp_path / "empty").mkdir()
    named = [*images, *sources(["empty", "film.mp4", "rtsp://camera"], [], Span())]
    found, _ = run(named, options)
    errors = {image.source: image.error for image in found if image.error}
    assert errors.keys() == {"07.png", "empty", "film.mp4", "rtsp://camera"}
    assert errors["07.png"] == (
        f"{tmp_path}/07.png: not a readable image; replace it with an intact PNG or JPEG"
    )
    assert "holds no image" in errors["empty"]
    assert errors["film.mp4"].startswith("film.mp4: neither an image nor a folder of images")
    with pytest.raises(InputError, match=r"07\.png: not a readable image"):
        next(found[7].frames(pytest.fail))


def test_an_image_that_no_process_survives_costs_none_but_itself(
    images: list[Source], options: FinderOptions
) -> None:
    def deadly(work: Work, chunks: Iterable[Chunk]) -> Predicted:
        for chunk in chunks:
            dies = any(source.name == "03.png" for source in chunk.sources)
            yield chunk, None if dies else work(chunk)

    found, _ = run(images, options, deadly)
    assert [image.source for image in found] == [image.name for image in images]
    (lost,) = [image for image in found if image.error]
    assert lost.error.startswith("03.png: every process that looked for its shafts died")


def test_a_run_loads_the_model_once(
    images: list[Source], options: FinderOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    loads, finder = [], FinderOptions.finder
    monkeypatch.setattr(FinderOptions, "finder", lambda *a: loads.append(a) or finder(*a))
    run(images, options)
    assert len(loads) == 1
    run(images, options)  # the model's file may be another one by now
    assert len(loads) == 2


def test_threads_of_a_worker_load_the_model_once(
    images: list[Source], options: FinderOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    loads, finder = [], FinderOptions.finder

    def slow(*arguments: Any) -> Any:
        loads.append(arguments)
        time.sleep(0.1)  # the other thread comes meanwhile
        return finder(*arguments)

    def threads(work: Work, chunks: Iterable[Chunk]) -> Predicted:
        with ThreadPoolExecutor(2) as pool:
            todo = list(chunks)
            yield from zip(todo, pool.map(work, todo), strict=True)

    monkeypatch.setattr(FinderOptions, "finder", slow)
    found, warnings = run(images, replace(options, view_deg=60.0), threads)
    assert len(loads) == 1
    assert all(len(image.shafts) == 1 for image in found)
    assert len(warnings) == 1


def test_a_warning_about_frames_is_given_once(images: list[Source], options: FinderOptions) -> None:
    _, warnings = run(images, replace(options, view_deg=60.0))
    (warning,) = warnings  # the caller was warned of the unknown diameter when it checked options
    assert warning.startswith("frames of 40 x 30 px fill only")


@pytest.mark.parametrize("content", [None, b"another model"])
def test_another_model_under_the_same_path_is_refused(
    content: bytes | None, images: list[Source], options: FinderOptions, constant_model: Path
) -> None:
    def on_another_machine(work: Work, chunks: Iterable[Chunk]) -> Predicted:
        for chunk in chunks:
            constant_model.unlink() if content is None else constant_model.write_bytes(content)
            yield chunk, work(chunk)

    where = f"^{re.escape(socket.gethostname())}: {constant_model}: missing, or differs"
    with pytest.raises(InputError, match=where):
        run(images, options, on_another_machine)


def test_other_software_is_refused(
    images: list[Source], options: FinderOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    def older(work: Work, chunks: Iterable[Chunk]) -> Predicted:
        for chunk in chunks:
            software = dict(chunk.run.software) | {"numpy": "1.0.0"}
            older_run = replace(chunk.run, software=tuple(software.items()))
            yield chunk, work(replace(chunk, run=older_run))

    different = f"other software than .*: numpy {np.__version__} instead of 1.0.0; install the same"
    with pytest.raises(InputError, match=f"^{re.escape(socket.gethostname())}: {different}"):
        run(images, options, older)


def test_openvino_gives_the_same_results(images: list[Source], options: FinderOptions) -> None:
    found, _ = run(images, replace(options, backend="openvino"))
    assert str(found) == str(run(images, options)[0])
