"""Videos for tests."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np


def write_video(path: Path, greys: Sequence[int], width: int = 64, height: int = 48) -> Path:
    """Frames of one grey each, 10 a second, each compressed on its own."""
    code = cv2.VideoWriter.fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(path), code, 10, (width, height))
    assert writer.isOpened()
    for grey in greys:
        writer.write(np.full((height, width, 3), grey, dtype=np.uint8))
    writer.release()
    return path


def read_greys(path: Path) -> list[float]:
    """The mean brightness of each frame."""
    capture, greys = cv2.VideoCapture(str(path)), []
    while (frame := capture.read()[1]) is not None:
        greys.append(float(frame.mean()))
    return greys
