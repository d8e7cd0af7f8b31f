"""Memory over many frames: `make bench-soak`.

The package's default model finds the shafts in large frames, one after another. The growth of its
process since the first thousand is written to `reports/benchmarks/soak.json`.
"""

import argparse
from pathlib import Path

import psutil
from tqdm import tqdm

from benchmarks.inference import finder, frames
from benchmarks.machine import RESULTS, machine
from shaftpose.core.files import write_json
from shaftpose.inference.model_files import DEFAULT

ROOT = Path(__file__).parents[1]
OUT = RESULTS / "soak.json"
SETTLED = 1000  # frames after which memory should not grow


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=20_000, help="number of frames (20,000)")
    total = parser.parse_args().frames
    if total <= SETTLED:
        parser.error(f"--frames {total}: memory is compared with that after {SETTLED} frames")
    settled, last = resident_mib(total)
    growth = round(last / settled - 1, 4)
    found = {"frames": total, "settled": SETTLED, "mib": round(last), "rss_growth": growth}
    write_json(OUT, {"machine": machine(), **found})
    print(f"{found}\nwritten to {OUT}")


def resident_mib(total: int) -> tuple[float, float]:
    """The memory of this process after the first frames, and after all."""
    find, images, process = finder(DEFAULT, "edges"), frames(), psutil.Process()
    measured = {}
    for number in tqdm(range(1, total + 1), "predicting", unit="frame", disable=None):
        find(next(images))
        if number in (SETTLED, total):
            measured[number] = process.memory_info().rss / 2**20
    return measured[SETTLED], measured[total]


if __name__ == "__main__":
    main()
