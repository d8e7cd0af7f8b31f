"""The gain from memory in huge pages: `make bench-pages`, after `dvc repro split`.

Processes that ask for them and processes that do not, in turn, train D of the profile `bench` and
find shafts in large frames. Prints the medians and writes `reports/benchmarks/page_size.json`.
"""

import argparse
import os
import statistics
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from benchmarks.inference import finder, frames, times
from benchmarks.machine import RESULTS, machine
from benchmarks.training import WARM_UP, loop_seconds, recipe_of
from shaftpose.core.files import write_json
from shaftpose.huge_pages import ASK, TUNABLES
from shaftpose.inference.model_files import DEFAULT
from shaftpose.training.assembly import build_module

OUT = RESULTS / "page_size.json"
PROCESSES = 5  # of each kind
STEPS, FRAMES = 20, 10  # that a process times


def main() -> None:
    """Measure and write; a process started with `--time` prints its speed alone."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--time", choices=TIMED, help=argparse.SUPPRESS)
    if (what := parser.parse_args().time) is not None:
        print(TIMED[what]())
        return
    rows = [row(what) for what in TIMED]
    write_json(OUT, {"machine": machine(), "processes": PROCESSES, "speeds": rows})
    for one in rows:
        print(one)
    print(f"written to {OUT}")


def row(what: str) -> dict[str, Any]:
    """The medians of both kinds, in images per second, and of each pair's ratio."""
    pairs = [(speed(what, ""), speed(what, ASK)) for _ in range(PROCESSES)]
    usual, huge = (statistics.median(column) for column in zip(*pairs, strict=True))
    gain = statistics.median(asked / plain for plain, asked in pairs)
    return {
        "what": what,
        "usual_images_per_s": round(usual, 2),
        "huge_pages_images_per_s": round(huge, 2),
        "gain": round(gain, 2),
    }


def speed(what: str, tunables: str) -> float:
    """Images per second in a new process with these tunables."""
    command = [sys.executable, "-m", "benchmarks.page_size", "--time", what]
    environment = os.environ | {TUNABLES: tunables}
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return float(done.stdout.splitlines()[-1])


def training(profile: str, steps: int) -> float:
    """Images per second of D's training steps, with reading and augmentation."""
    recipe = recipe_of(profile)
    sizes = replace(recipe.size, steps=WARM_UP + steps, warmup_steps=0)
    recipe = replace(recipe, size=sizes)
    return steps * sizes.batch_size / loop_seconds(recipe, build_module(recipe))


def prediction(count: int) -> float:
    """Frames per second of the package's model, with its fit."""
    (seconds,) = times({DEFAULT: finder(DEFAULT, "edges")}, frames(), 1, count).values()
    return 1 / statistics.median(seconds)


TIMED: dict[str, Callable[[], float]] = {
    "training": partial(training, "bench", STEPS),
    "prediction": partial(prediction, FRAMES),
}


if __name__ == "__main__":
    main()
