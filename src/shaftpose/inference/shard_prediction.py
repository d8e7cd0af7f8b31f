"""Predictions for data sets, for export and evaluation."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from shaftpose.core.instruments import Annotations, Detections
from shaftpose.core.shards import ShardedDataset
from shaftpose.inference.predictor import Predictor

BATCH = 8


def predict(
    predictor: Predictor, images: Iterable[NDArray[np.uint8]], total: int
) -> list[Detections]:
    """Detections in each image (H, W, 3), in batches, with a progress bar."""
    found: list[Detections] = []
    with tqdm(total=total, desc="predicting", unit="image", disable=None) as bar:
        for batch in _batches(images):
            found += predictor(np.stack(batch))
            bar.update(len(batch))
    return found


def predict_shards(
    predictor: Predictor, shards: ShardedDataset, keys: Sequence[str]
) -> tuple[list[Detections], list[Annotations]]:
    """The detections in rendered images, and their annotations."""
    found = predict(predictor, (shards.rgb(key) for key in keys), len(keys))
    return found, [shards.annotations(key) for key in keys]


def confidence_threshold(chosen: float | None, predictor: Predictor) -> float:
    """The user's confidence threshold, or the model's if that is None."""
    return predictor.confidence if chosen is None else chosen


def _batches(images: Iterable[NDArray[np.uint8]]) -> Iterator[list[NDArray[np.uint8]]]:
    rest = iter(images)
    while batch := list(islice(rest, BATCH)):
        yield batch
