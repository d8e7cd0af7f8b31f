"""Runs an exported model: images in, detections out."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from shaftpose.core.instruments import Detections
from shaftpose.errors import InputError

# Keys of the model file's metadata.
CONFIDENCE = "confidence"
VIEW_DEG = "view_deg"
SHAFT_DIAMETER_MM = "shaft_diameter_mm"
# For models whose files state no camera: that of the paper.
_VIEW_DEG_UNSTATED = 95.0


class Predictor:
    """An ONNX file written by the export stage, run by onnxruntime.

    Raises InputError naming the file if it is missing or is not such a model.
    """

    def __init__(self, path: Path, providers: Sequence[str] = ("CPUExecutionProvider",)) -> None:
        if not path.is_file():
            raise InputError(f"{path}: no such model; run the export stage")
        try:
            self._session = onnxruntime.InferenceSession(str(path), providers=list(providers))
        except Exception as error:  # onnxruntime's own exceptions have no common base
            raise InputError(f"{path}: not a readable ONNX model; export it again") from error
        names = [output.name for output in self._session.get_outputs()]
        if names != ["boxes", "scores", "poses"]:
            raise InputError(f"{path}: its outputs are {names}; use a model of the export stage")
        self._path = path
        self._stated = self._session.get_modelmeta().custom_metadata_map

    @property
    def side_px(self) -> int:
        """The side of the square images that the model takes."""
        return int(self._session.get_inputs()[0].shape[1])

    @property
    def confidence(self) -> float:
        """The model's confidence threshold, chosen on validation images.

        Raises InputError naming the file if it states none.
        """
        if CONFIDENCE not in self._stated:
            raise InputError(
                f"{self._path}: holds no confidence threshold; export it again or set one"
            )
        return float(self._stated[CONFIDENCE])

    @property
    def view_deg(self) -> float:
        """The field of view, in deg, that the model was trained for."""
        return float(self._stated.get(VIEW_DEG, _VIEW_DEG_UNSTATED))

    @property
    def shaft_diameter_mm(self) -> float | None:
        """The shaft diameter that the model was trained for; None if the file states none, as for
        an instrument from a CAD file."""
        stated = self._stated.get(SHAFT_DIAMETER_MM)
        return None if stated is None else float(stated)

    def __call__(self, images: NDArray[np.uint8]) -> list[Detections]:
        """The detections in each of the images (N, 299, 299, 3) uint8 RGB, best score first."""
        boxes, scores, poses = self._session.run(None, {"image": images})
        return [
            Detections(b[s > 0].astype(float), s[s > 0].astype(float), p[s > 0].astype(float))
            for b, s, p in zip(boxes, scores, poses, strict=True)
        ]

    def frames_per_second(self, image: NDArray[np.uint8], repetitions: int = 30) -> float:
        """Images per second at batch size 1: median of `repetitions` calls after 3 warm-up calls.

        image: (299, 299, 3) uint8 RGB.
        """
        seconds = []
        for _ in range(repetitions + 3):
            start = time.perf_counter()
            self._session.run(None, {"image": image[None]})
            seconds.append(time.perf_counter() - start)
        return float(1 / np.median(seconds[3:]))
