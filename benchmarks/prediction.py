"""How fast exported models run: `make bench`, after `make repro`.

Prints images per second of every `models/*/model.onnx` by batch size, decoding and non-maximum
suppression included, and writes them to `benchmarks/results/prediction.json`.
"""

import json
import statistics
import sys
import time
from pathlib import Path

import numpy as np
import onnxruntime

from benchmarks.machine import machine
from shaftpose.deployment.predictor import Predictor
from shaftpose.shards import ShardedDataset

ROOT = Path(__file__).parents[1]
OUT = ROOT / "benchmarks" / "results" / "prediction.json"
BATCHES = (1, 4, 16)
ROUNDS = 20


def main() -> None:
    """Time all models side by side: each round runs every model at every batch size once."""
    models = sorted((ROOT / "models").glob("*/model.onnx"))
    if not models:
        sys.exit("error: models/: no model.onnx in it; run `make repro`")
    shards = ShardedDataset(ROOT / "data/render/images")
    images = np.stack([shards.rgb(key) for key in shards.keys[: max(BATCHES)]])
    predictors = {path.parent.name: Predictor(path) for path in models}
    seconds: dict[tuple[str, int], list[float]] = {}
    for _ in range(ROUNDS + 1):
        for name, predictor in predictors.items():
            for batch in BATCHES:
                start = time.perf_counter()
                predictor(images[:batch])
                seconds.setdefault((name, batch), []).append(time.perf_counter() - start)
    # The first round warms up.
    speeds = {key: key[1] / statistics.median(taken[1:]) for key, taken in seconds.items()}
    print("images/s   " + "".join(f"batch {batch:<4}" for batch in BATCHES))
    for name in predictors:
        print(f"{name:<14}" + "".join(f"{speeds[name, batch]:<10.1f}" for batch in BATCHES))
    write(speeds)


def write(speeds: dict[tuple[str, int], float]) -> None:
    """The speeds with what they were measured on."""
    result = {
        "machine": machine(),
        "onnxruntime": onnxruntime.__version__,
        "rounds": ROUNDS,
        "images_per_s": [
            {"variant": name, "batch": batch, "median": round(speed, 1)}
            for (name, batch), speed in speeds.items()
        ],
    }
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(json.dumps(result, indent=1) + "\n")
    print(f"written to {OUT.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
