"""Time and peak memory from a whole frame to fitted poses, next to those of its central square.

`python -m studies.whole_frames.cost MODEL VIEW_DEG DIAMETER_MM X,Y,W,H FOLDER` prints the peak
memory, in MiB, of a process that finds shafts in that part of the images of a folder.
"""

import statistics
import subprocess
import sys
from collections.abc import Iterator
from itertools import cycle, islice
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.inference import peak_mib, times
from shaftpose.core.images import resized, write_jpeg
from shaftpose.image_files.reading import read_rgb
from shaftpose.inference.frame_views import Crop
from shaftpose.inference.loading import load
from studies.whole_frames.frames import AnnotatedFrame
from studies.whole_frames.record import Figure

WIDTH, HEIGHT = 1920, 1080
WHOLE, SQUARE = (0, 0, WIDTH, HEIGHT), ((WIDTH - HEIGHT) // 2, 0, HEIGHT, HEIGHT)
_IMAGES, _PASSES = 10, 5
_MOST_TIME, _MOST_MEMORY = 1.6, 1.3


def main() -> None:
    """Print the peak memory of the command line's run."""
    model, view_deg, diameter_mm, part, folder = sys.argv[1:]
    x, y, width, height = map(int, part.split(","))
    crop = x, y, width, height
    find = load(model, view_deg=float(view_deg), diameter_mm=float(diameter_mm), crop=crop)
    for path in sorted(Path(folder).iterdir()) * _PASSES:
        find(read_rgb(path))
    print(peak_mib())


def cost_figures(
    model: Path, diameter_mm: float, frames: Iterator[AnnotatedFrame], count: int
) -> list[Figure]:
    """Whole frames and their central squares in turn, `count` of each."""
    chosen = list(islice(frames, _IMAGES))
    images = [resized(frame.rgb, WIDTH, HEIGHT) for frame in chosen]
    view_deg = chosen[0].view_deg
    finders = {
        part: load(model, view_deg=view_deg, diameter_mm=diameter_mm, crop=part)
        for part in (WHOLE, SQUARE)
    }
    rounds = max(count // len(images), 1)
    seconds = times(finders, cycle(images), rounds, len(images))
    ms = {part: 1000 * statistics.median(taken) for part, taken in seconds.items()}
    with TemporaryDirectory() as folder:
        for number, image in enumerate(images):
            write_jpeg(image, Path(folder) / f"{number}.jpg")
        mib = {
            part: _peak_mib(model, view_deg, diameter_mm, part, folder) for part in (WHOLE, SQUARE)
        }
    on = f"{rounds * len(images)} frames"
    return [
        Figure("median time [ms]", ms[WHOLE], on),
        Figure(
            "median time, over that of the central square", ms[WHOLE] / ms[SQUARE], on,
            most=_MOST_TIME,
        ),
        Figure("peak memory [MiB]", mib[WHOLE], "1 process"),
        Figure(
            "peak memory, over that of the central square", mib[WHOLE] / mib[SQUARE],
            "2 processes", most=_MOST_MEMORY,
        ),
    ]  # fmt: skip


def _peak_mib(model: Path, view_deg: float, diameter_mm: float, part: Crop, folder: str) -> float:
    words = [str(model), str(view_deg), str(diameter_mm), ",".join(map(str, part)), folder]
    command = [sys.executable, "-m", "studies.whole_frames.cost", *words]
    return float(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


if __name__ == "__main__":
    main()
