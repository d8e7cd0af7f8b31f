"""Predictions for a list of images, as export, evaluate and evaluate_real need them alike."""

from collections.abc import Iterable, Iterator
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from stage import Config
from tqdm import tqdm

from shaftpose.config import DetectionSettings, parse
from shaftpose.deployment.predictor import Predictor
from shaftpose.instruments import Detections

BATCH = 8


def predict(
    predictor: Predictor, images: Iterable[NDArray[np.uint8]], total: int
) -> list[Detections]:
    """Detections in each image (H, W, 3), in batches, with a progress bar."""
    found: list[Detections] = []
    with tqdm(total=total, desc="predicting", unit="image") as bar:
        for batch in _batches(images):
            found += predictor(np.stack(batch))
            bar.update(len(batch))
    return found


def least_confidence(config: Config, predictor: Predictor) -> float:
    """The score from which on detections count: the user's, else the model's own."""
    chosen = parse(DetectionSettings, config["detection"], "params.yaml: detection").confidence
    return predictor.confidence if chosen is None else chosen


def _batches(images: Iterable[NDArray[np.uint8]]) -> Iterator[list[NDArray[np.uint8]]]:
    rest = iter(images)
    while batch := list(islice(rest, BATCH)):
        yield batch
