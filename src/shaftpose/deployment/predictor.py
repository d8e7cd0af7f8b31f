"""Runs an exported model: images in, detections out."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from shaftpose.errors import InputError
from shaftpose.instruments import Detections

# The model file's metadata that holds the score from which on its detections count.
CONFIDENCE = "confidence"


class Predictor:
    """An ONNX file written by the export stage, run by onnxruntime.

    Raises InputError naming the file if it is missing or no such model.
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

    @property
    def confidence(self) -> float:
        """The score from which on the model's detections count, chosen on validation images.

        Raises InputError naming the file if it does not say.
        """
        known = self._session.get_modelmeta().custom_metadata_map
        if CONFIDENCE not in known:
            raise InputError(f"{self._path}: holds no confidence; export it again or state one")
        return float(known[CONFIDENCE])

    def __call__(self, images: NDArray[np.uint8]) -> list[Detections]:
        """The detections in each of the images (N, 299, 299, 3) uint8 RGB, best score first."""
        boxes, scores, poses = self._session.run(None, {"image": images})
        return [
            Detections(b[s > 0].astype(float), s[s > 0].astype(float), p[s > 0].astype(float))
            for b, s, p in zip(boxes, scores, poses, strict=True)
        ]

    def frames_per_second(self, image: NDArray[np.uint8], repetitions: int = 30) -> float:
        """Images per second at batch 1, from the median of `repetitions` calls after 3 to warm up.

        image: (299, 299, 3) uint8 RGB.
        """
        seconds = []
        for _ in range(repetitions + 3):
            start = time.perf_counter()
            self._session.run(None, {"image": image[None]})
            seconds.append(time.perf_counter() - start)
        return float(1 / np.median(seconds[3:]))
