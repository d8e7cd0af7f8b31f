"""`shaftpose check`: tests whether prediction works on this machine, and with a camera.

Packages are imported only while they are checked, so that a broken one is reported.
"""

import argparse
import os
import platform
from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.resources import as_file, files
from pathlib import Path
from tempfile import TemporaryDirectory

from shaftpose import huge_pages
from shaftpose.core.errors import InputError
from shaftpose.inference.model_files import DEFAULT
from shaftpose.origin import processor

_PACKAGES = ("numpy", "cv2", "onnxruntime", "tqdm")
_SPEED_RUNS = 10


def run(options: argparse.Namespace) -> None:
    """Print each finding. Raises InputError if prediction would fail."""
    print(f"python: {platform.python_version()}, {platform.platform()}")
    print(f"processor: {processor()}, {os.cpu_count()} cores")
    if command := huge_pages.advice():
        print(f"memory: not in huge pages, in which networks are faster; before: {command}")
    name = options.model or DEFAULT
    checks: dict[str, Callable[[], str]]
    checks = {"packages": packages, "videos": videos, "model": partial(model, name)}
    failed = [part for part, check in checks.items() if not _passes(part, check)]
    if failed:
        raise InputError(f"cannot predict here: {', '.join(failed)}; see the lines above")
    if options.camera is not None:
        print(f"camera: {camera(options.camera, name)}")
    print("this machine can predict; for rendering and training: tools/check_system.py in a clone")


def _passes(name: str, check: Callable[[], str]) -> bool:
    try:
        print(f"{name}: {check()}")
    except Exception as error:  # of any kind: it is the finding
        print(f"{name}: FAILED: {error}")
        return False
    return True


def packages() -> str:
    """The versions of all packages. Raises ImportError if one is missing or cannot be loaded."""
    return ", ".join(f"{name} {import_module(name).__version__}" for name in _PACKAGES)


def videos() -> str:
    """Write and read a video. Raises InputError if OpenCV cannot."""
    import cv2
    import numpy as np

    from shaftpose.inference.annotated_files import codec

    with TemporaryDirectory() as folder:
        path = f"{folder}/video.mp4"
        writer = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*codec()), 25, (64, 64))
        writer.write(np.zeros((64, 64, 3), dtype=np.uint8))
        writer.release()
        if not cv2.VideoCapture(path).read()[0]:
            raise InputError("OpenCV cannot write MP4; reinstall opencv-python-headless")
    plays = "H.264" if codec() == "avc1" else "MPEG-4, which browsers do not play"
    return f"OpenCV writes and reads MP4 with {plays}"


def model(name: str) -> str:
    """The speed of a model, see `model_file`. Raises InputError if it cannot be used."""
    from shaftpose.core.images import centre_square
    from shaftpose.image_files.reading import read_rgb
    from shaftpose.inference.model_files import model_file
    from shaftpose.inference.predictor import Predictor

    with model_file(name) as file:
        predictor = Predictor(file)
    # A frame that shows shafts, because fitting their poses takes time, too.
    with as_file(files("shaftpose.inference") / "demo_frame.jpg") as frame:
        image = centre_square(read_rgb(frame), predictor.side_px)
    speed = predictor.frames_per_second(image, _SPEED_RUNS)
    return f"{name}, {speed:.0f} images of {predictor.side_px} px per second"


def camera(path: Path, name: str) -> str:
    """The size and scale at which a model sees a camera's frames, what it does not see of them, and
    the setting to train for that camera.

    Raises InputError naming the file if it is not a calibration or states no size.
    """
    from shaftpose.inference.calibration_files import read_camera
    from shaftpose.inference.frame_views import views
    from shaftpose.inference.loading import NO_OTHER_CAMERA
    from shaftpose.inference.model_files import model_file
    from shaftpose.inference.predictor import Predictor

    notes: list[str] = []
    with model_file(name) as file:
        stated, predictor = read_camera(path, notes.append), Predictor(file)
    if predictor.metadata.distorted:
        raise InputError(f"{name}: {NO_OTHER_CAMERA}: leave out --camera")
    if stated.size is None:
        raise InputError(f"{path}: states no image_width and image_height; add them")
    (width, height), own = stated.size, stated(*stated.size)
    of_frames = views(stated, predictor.camera, predictor.frame_px, None, notes.append)
    seen = of_frames(width, height, 1.0).camera
    lens = "fisheye" if own.fisheye else f"{own.distortion.size} coefficients"
    return "; ".join([
        f"frames of {width} x {height} px ({lens})",
        f"{name} sees them as {seen.width} x {seen.height} px, "
        f"{own.focal_px / seen.focal_px:.2g} px of the frame in one",
        *notes,
        f"to train for this camera, set camera.view_deg to {own.widest_view_deg():.1f}",
    ])  # fmt: skip
