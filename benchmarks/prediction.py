"""Speed of exported models: `make bench`, after `make repro`.

Prints images per second of every `models/*/model.onnx` by batch size, decoding, non-maximum
suppression and the fit of poses included, and writes them to `reports/benchmarks/prediction.json`.
"""

import statistics
from collections.abc import Mapping
from functools import partial
from itertools import repeat
from pathlib import Path

import numpy as np
import onnxruntime

from benchmarks.inference import times
from benchmarks.machine import RESULTS, machine
from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.files import write_json
from shaftpose.core.images import Image
from shaftpose.core.shards import ShardedDataset
from shaftpose.inference.predictor import Predictor

ROOT = Path(__file__).parents[1]
OUT = RESULTS / "prediction.json"
BATCHES = (1, 4, 16)
ROUNDS = 20


def main() -> None:
    """Print and write the speeds of all models built by `make repro`."""
    with exit_on_input_error():
        predictors, images = inputs()
    speeds = measure(predictors, images)
    print("images/s   " + "".join(f"batch {batch:<4}" for batch in BATCHES))
    for name in predictors:
        print(f"{name:<14}" + "".join(f"{speeds[name, batch]:<10.1f}" for batch in BATCHES))
    write(speeds)


def inputs() -> tuple[dict[str, Predictor], Image]:
    """The models by variant, and images (N, 299, 299, 3) for the largest batch."""
    models = sorted((ROOT / "models").glob("*/model.onnx"))
    if not models:
        raise InputError("models/: no model.onnx in it; run `make repro`")
    shards = ShardedDataset(ROOT / "data/render/images")
    if len(shards) < max(BATCHES):
        raise InputError(f"{shards.folder}: holds {len(shards)} images; render {max(BATCHES)}")
    images = np.stack([shards.rgb(key) for key in shards.keys[: max(BATCHES)]])
    return {path.parent.name: Predictor(path) for path in models}, images


def measure(predictors: Mapping[str, Predictor], images: Image) -> dict[tuple[str, int], float]:
    """Median images/s by variant and batch size; each round runs every model at every batch size
    once."""
    runs = {
        (name, batch): partial(_run, predictor, batch)
        for name, predictor in predictors.items()
        for batch in BATCHES
    }
    seconds = times(runs, repeat(images), ROUNDS, per_round=1)
    return {key: key[1] / statistics.median(taken) for key, taken in seconds.items()}


def _run(predictor: Predictor, batch: int, images: Image) -> object:
    return predictor(images[:batch])


def write(speeds: dict[tuple[str, int], float]) -> None:
    """Write the speeds with a description of the machine."""
    result = {
        "machine": machine(),
        "onnxruntime": onnxruntime.__version__,
        "rounds": ROUNDS,
        "images_per_s": [
            {"variant": name, "batch": batch, "median": round(speed, 1)}
            for (name, batch), speed in speeds.items()
        ],
    }
    write_json(OUT, result)
    print(f"written to {OUT}")


if __name__ == "__main__":
    main()
