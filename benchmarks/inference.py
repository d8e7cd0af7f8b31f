"""Speed and memory from a decoded frame to poses: `make bench-inference`, on an idle machine.

Frames of 1920 x 1080 px go through the package's models one by one, with each way to refine poses
in turn, and the figures are written to `reports/benchmarks/inference.json`.
"""

import math
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Hashable, Iterator, Mapping
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar, get_args

import cv2
import numpy as np
import onnxruntime
from tqdm import tqdm

from benchmarks.machine import RESULTS, machine
from shaftpose.core.files import write_json
from shaftpose.core.images import Image
from shaftpose.frame_sources.video_files import VideoFile
from shaftpose.inference.backends import open_network
from shaftpose.inference.frame_views import views
from shaftpose.inference.loading import load
from shaftpose.inference.model_files import bundled_model, bundled_names
from shaftpose.inference.predictor import Predictor
from shaftpose.inference.shaft_finder import ShaftFinder
from shaftpose.settings.choices import Refinement

ROOT = Path(__file__).parents[1]
OUT = RESULTS / "inference.json"
FILM = ROOT / "src/shaftpose/inference/demo_film.mp4"
WIDTH, HEIGHT = 1920, 1080
# Of the frames, across their height, as `load` takes it; across their width they show 95 deg, as
# the square film does.
VIEW_DEG = math.degrees(2 * math.atan(HEIGHT / WIDTH * math.tan(math.radians(95 / 2))))
ROUNDS, PER_ROUND = 30, 10  # frames of each model and refinement in turn
STARTS, MORE_FRAMES = 3, 50
NETWORK = "network alone"  # in place of a refinement
Run = Callable[[Image], object]
Name = TypeVar("Name", bound=Hashable)
PAUSE_S = 0.1  # the threads of a model keep spinning for a while
# A new process: seconds until the poses in a first frame, imports included, then its peak memory
# after more frames, in MiB.
START = """
import sys, time
start = time.perf_counter()
import cv2, numpy as np
from shaftpose.inference.loading import load
model, refine, image, view_deg, more_frames = sys.argv[1:]
find = load(model, view_deg=float(view_deg), diameter_mm=3.0, refine=refine)
find(cv2.imread(image)[..., ::-1])
seconds = time.perf_counter() - start
from benchmarks.inference import frames, peak_mib
images = frames()
for _ in range(int(more_frames)):
    find(next(images))
print(seconds, peak_mib())
"""


def main() -> None:
    """Measure and write."""
    # The package's models state no threshold for poses refined in views.
    fits = [refine for refine in get_args(Refinement) if refine != "views"]
    names = [(model, refine) for model in bundled_names() for refine in fits]
    runs = {name: finder(*name) for name in names} | networks()
    seconds = times(runs, frames(), ROUNDS, PER_ROUND)
    rows = [row(*name, seconds[name], seconds[name[0], NETWORK]) for name in names]
    result = {
        "machine": machine(),
        "onnxruntime": onnxruntime.__version__,
        "frame": {"width": WIDTH, "height": HEIGHT},
        "frames": ROUNDS * PER_ROUND,
        "models": rows,
    }
    write_json(OUT, result)
    for one in rows:
        print(one)
    print(f"written to {OUT}")


def finder(model: str, refine: Refinement) -> ShaftFinder:
    """A model for the camera of `frames` and the film's shafts."""
    return load(model, view_deg=VIEW_DEG, diameter_mm=3.0, refine=refine)


def networks() -> dict[tuple[str, str], Run]:
    """The networks of the models alone, with a frame of the size that they see."""
    return {(model, NETWORK): network(bundled_model(model)) for model in bundled_names()}


def network(path: Path) -> Run:
    """A network alone."""
    opened, model = open_network(path, "onnxruntime"), Predictor(path)
    view = views(None, model.camera, model.frame_px, None, lambda _: None)(WIDTH, HEIGHT, 1.0)
    small = view.picture(next(frames()))[None]
    return lambda _: opened.run(opened.outputs, small)


def frames() -> Iterator[Image]:
    """The package's film, enlarged to the width of the frames and cut to their height; endless."""
    top = (WIDTH - HEIGHT) // 2
    for frame in cycle(list(VideoFile(FILM).frames())):
        square = cv2.resize(frame.rgb, (WIDTH, WIDTH), interpolation=cv2.INTER_CUBIC)
        yield np.asarray(square[top : top + HEIGHT], np.uint8)


def times(
    runs: Mapping[Name, Run], images: Iterator[Image], rounds: int, per_round: int
) -> dict[Name, list[float]]:
    """Seconds of each image; each round runs all of them."""
    seconds: dict[Name, list[float]] = {name: [] for name in runs}
    for number in tqdm(range(rounds + 1), "rounds", disable=None):
        batch = [next(images) for _ in range(per_round)]
        for name, run in runs.items():
            time.sleep(PAUSE_S)
            taken = [_seconds(run, image) for image in batch]
            seconds[name] += taken if number else []  # the first round warms up
    return seconds


def _seconds(run: Run, image: Image) -> float:
    start = time.perf_counter()
    run(image)
    return time.perf_counter() - start


def row(model: str, refine: Refinement, seconds: list[float], alone: list[float]) -> dict[str, Any]:
    """The figures of a model with a refinement; alone: seconds of the network.

    pre_post_share: of the time, what is spent outside of one run of the network. A fit is included,
    and with it the run on the turned image.
    """
    with TemporaryDirectory() as folder:
        first = Path(folder) / "frame.png"
        cv2.imwrite(str(first), next(frames())[..., ::-1])
        arguments = [model, refine, str(first), str(VIEW_DEG), str(MORE_FRAMES)]
        command = [sys.executable, "-c", START, *arguments]
        starts = [
            subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT)
            for _ in range(STARTS)
        ]
    cold, peaks = zip(*(map(float, start.stdout.split()) for start in starts), strict=True)
    return {
        "model": model,
        "refine": refine,
        "fps_median": round(1 / statistics.median(seconds), 1),
        "pre_post_share": round(1 - statistics.median(alone) / statistics.median(seconds), 2),
        "ms_p95": round(1000 * float(np.percentile(seconds, 95)), 1),
        "cold_start_s": round(statistics.median(cold), 2),
        "rss_mib": round(max(peaks)),
    }


def peak_mib() -> float:
    """The peak memory of this process, which getrusage would mix with its parent's."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


if __name__ == "__main__":
    main()
