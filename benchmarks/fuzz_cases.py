"""Damaged and odd inputs for `benchmarks.fuzz`, one kind in a function each.

A function writes a random input to an empty folder and reads it. It raises InputError if the input
is refused with a message, and AssertionError if it is read wrongly without a warning.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from numpy.random import Generator

from shaftpose.core.geometry import Camera
from shaftpose.dataset.coco import read_coco
from shaftpose.frame_sources.video_files import Span
from shaftpose.inference.calibration_files import read_camera
from shaftpose.inference.frame_views import views
from shaftpose.inference.model_files import bundled_model
from shaftpose.inference.prediction_run import sources
from shaftpose.inference.predictor import Predictor
from shaftpose.network.checkpoint import identity_of

Read = Callable[[Path, Generator], None]

MODEL = Camera.from_field_of_view(299, 299, 95.0)
CAMERA = """image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [500.0, 0.0, 320.5, 0.0, 510.0, 239.25, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.25, 0.1, 0.001, 0.0, 0.01]}
"""
COCO = {
    "images": [{"id": 4, "file_name": "a.png", "width": 60, "height": 40}],
    "annotations": [
        {"id": 1, "image_id": 4, "bbox": [10, 5, 20, 30],
         "segmentation": [[10, 5, 30, 5, 30, 35, 10, 35]], "attributes": {"tip": [12.0, 9.0]}}
    ],
    "categories": [{"id": 1, "name": "shaft"}],
}  # fmt: skip
ODD = (
    "nan", ".inf", "-1", "0", "1e308", "-1e-308", "9" * 40, "true", "null", '"x"', "[]", "{}", "é",
    "\x00", "[" * 5000, "{a: " * 5000, "- " * 5000, "1, " * 100_000, "equidistant", "",
)  # fmt: skip
FRAMES = 12


def odd_text(text: str, rng: Generator) -> str:
    """The text with one to three of its words and numbers replaced."""
    for _ in range(rng.integers(1, 4)):
        places = [word.span() for word in re.finditer(r"[\w.+-]+", text)] or [(0, 0)]
        start, end = places[rng.integers(len(places))]
        text = text[:start] + str(rng.choice(ODD)) + text[end:]
    return text


def damaged(data: bytes, rng: Generator) -> bytes:
    """The bytes with flipped ones, an overwritten or repeated part, or cut short."""
    changed = np.frombuffer(data, np.uint8).copy()
    start, length = int(rng.integers(len(data))), int(rng.integers(1, 200))
    match rng.integers(5):
        case 0:
            changed[rng.integers(len(data), size=rng.integers(1, 8))] ^= 1 << rng.integers(8)
        case 1:
            changed[start : start + length] = rng.integers(256)
        case 2:
            changed = np.insert(changed, start, changed[start : start + length])
        case 3:
            head = changed[: min(200, len(data))]  # which states sizes
            head[rng.integers(len(head), size=4)] = rng.integers(256, size=4)
        case _:
            changed = changed[:start]
    return changed.tobytes()


def camera(folder: Path, rng: Generator) -> None:
    """A camera file, and the view of its frames."""
    path = folder / "cam.yaml"
    path.write_text(odd_text(CAMERA, rng))
    found = read_camera(path, lambda _: None)
    frame_px = MODEL.width if rng.integers(2) else None
    view = views(found, MODEL, frame_px, None, lambda _: None)
    ends = np.array([[0.0, 0.0], [MODEL.width, MODEL.height]])
    assert np.isfinite(view(*(found.size or (640, 480)), 1.0).image_px(ends)).all()


def model(folder: Path, rng: Generator) -> None:
    """A model file with odd metadata or damaged bytes, and its detections."""
    path, whole = folder / "model.onnx", onnx.load(str(bundled_model()))
    entry = whole.metadata_props[rng.integers(len(whole.metadata_props))]
    if rng.integers(2):
        entry.value = str(rng.choice(ODD))
    data = whole.SerializeToString()
    path.write_bytes(data if rng.integers(2) else damaged(data, rng))
    predictor = Predictor(path)
    (found,) = predictor(rng.integers(256, size=(1, 96, 96, 3), dtype=np.uint8))
    assert np.isfinite(found.poses).all() and np.isfinite(predictor.camera.focal_px)


def coco(folder: Path, rng: Generator) -> None:
    """A COCO file."""
    cv2.imwrite(str(folder / "a.png"), np.zeros((40, 60, 3), np.uint8))
    path, text = folder / "train.json", json.dumps(COCO)
    path.write_bytes(
        damaged(text.encode(), rng) if rng.integers(2) else odd_text(text, rng).encode()
    )
    assert all(len(image.instruments) < 2 for image in read_coco(path))


def checkpoint(folder: Path, rng: Generator) -> None:
    """A checkpoint: refused, or the weights that were written."""
    path, weights = folder / "last.ckpt", torch.arange(5000.0)
    torch.save({"identity": {"variant": "d"}, "state_dict": {"network.a": weights}}, path)
    path.write_bytes(damaged(path.read_bytes(), rng))
    assert identity_of(path) == {"variant": "d"}
    assert torch.equal(torch.load(path)["state_dict"]["network.a"], weights)


def image(folder: Path, rng: Generator) -> None:
    """An image file: refused, or one frame."""
    suffix = str(rng.choice([".png", ".jpg", ".bmp", ".tiff", ".webp", ".ppm"]))
    pixels = rng.integers(256, size=(40, 60, 3), dtype=np.uint8)
    path = folder / f"frame{suffix}"
    path.write_bytes(damaged(cv2.imencode(suffix, pixels)[1].tobytes(), rng))
    assert shows(path, 1)


def video(folder: Path, rng: Generator) -> None:
    """A video file: refused, or read with a warning, or with one frame missing at most."""
    kinds = [("MJPG", "avi"), ("mp4v", "mp4"), ("mp4v", "mkv")]
    code, suffix = kinds[rng.integers(len(kinds))]
    path = folder / f"film.{suffix}"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 25, (64, 64))
    for _ in range(FRAMES):
        writer.write(rng.integers(256, size=(64, 64, 3), dtype=np.uint8))
    writer.release()
    path.write_bytes(damaged(path.read_bytes(), rng))
    assert shows(path, FRAMES - 1)


def shows(path: Path, count: int) -> bool:
    """Whether a file gives this many frames, or there is a warning."""
    warnings: list[str] = []
    (source,) = sources([str(path)], [], Span())
    found = sum(frame.rgb.ndim == 3 for frame in source.frames(warnings.append))
    return found >= count or bool(warnings)


KINDS: tuple[Read, ...] = (camera, model, coco, checkpoint, image, video)
