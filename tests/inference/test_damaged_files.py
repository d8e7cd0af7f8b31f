"""Prediction survives images and models that are damaged in any way."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.random import Generator

from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.model_files import ModelMetadata

IMAGES, MODELS = 800, 300
FORMATS = ("png", "jpg", "bmp", "tiff", "webp")
# Loads each file named on standard input as a model and predicts with it; names those refused.
LOAD = """
import sys
import numpy as np
import onnxruntime
from pathlib import Path
from shaftpose.inference.predictor import Predictor
from shaftpose.core.errors import InputError

onnxruntime.set_default_logger_severity(4)
for line in sys.stdin:
    try:
        Predictor(Path(line.strip()))(np.zeros((1, 299, 299, 3), np.uint8))
    except InputError as error:
        print(error)
"""


def damaged(data: bytes, rng: Generator) -> bytes:
    """The bytes cut short, with some of them changed, removed, repeated or zeroed, or noise."""
    start, end = sorted(rng.integers(0, len(data), 2).tolist())
    changed = bytearray(data)
    for place in rng.integers(0, len(data), rng.integers(1, 20)):
        changed[place] = int(rng.integers(256))
    header = bytearray(data)
    header[int(rng.integers(0, min(64, len(data))))] = int(rng.integers(256))
    ways = (
        data[:start], bytes(changed), bytes(header), data[:start] + data[end:],
        data[:end] + data[start:], data[:start] + bytes(end - start) + data[end:],
        rng.bytes(end), b"",
    )  # fmt: skip
    return ways[int(rng.choice(len(ways), p=[0.2, 0.25, 0.25, 0.1, 0.05, 0.1, 0.04, 0.01]))]


def damaged_images(folder: Path) -> Iterator[Path]:
    """Files of five formats, most of them damaged."""
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 255, (40, 60, 3), dtype=np.uint8)
    intact = {suffix: cv2.imencode(f".{suffix}", picture)[1].tobytes() for suffix in FORMATS}
    for number in range(IMAGES):
        suffix = FORMATS[number % len(FORMATS)]
        path = folder / f"{number:04}.{suffix}"
        path.write_bytes(damaged(intact[suffix], rng) if number >= len(FORMATS) else intact[suffix])
        yield path


def test_each_image_gives_a_result_or_an_error(constant_model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    files = list(damaged_images(folder))
    store_metadata(constant_model, ModelMetadata(0.5, 95.0, 3.0))
    done = subprocess.run(
        [sys.executable, "-c", "from shaftpose.cli.main import main; main()", "predict",
         str(folder), "--model", str(constant_model), "--view-deg", "95", "--diameter-mm", "3"],
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    predicted = done.stdout.count("\n")
    refused = [line for line in done.stderr.splitlines() if line.startswith(f"error: {folder}")]
    assert predicted >= len(FORMATS)
    assert len(refused) > IMAGES / 4
    assert predicted + len(refused) == len(files)


def test_each_model_is_used_or_refused(constant_model: Path, tmp_path: Path) -> None:
    store_metadata(constant_model, ModelMetadata(0.5, 95.0, 3.0))
    rng, data, files = np.random.default_rng(0), constant_model.read_bytes(), []
    for number in range(MODELS):
        files.append(tmp_path / f"{number}.onnx")
        files[-1].write_bytes(damaged(data, rng))
    done = subprocess.run(
        [sys.executable, "-c", LOAD], input="\n".join(map(str, files)),
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    refused = done.stdout.splitlines()
    assert len(refused) > MODELS / 4
    assert all(line.startswith(str(tmp_path)) for line in refused)
