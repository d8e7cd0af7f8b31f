"""Show what the bundled model finds in a film of `studies.moving_shafts`: `make film`.

`python -m studies.film_results FOLDER` compares FOLDER/alone and FOLDER/tracked, predictions of
FOLDER/film.mp4 without and with `--track`, with the true poses. It writes the table of
docs/prediction.md, and the drawn film to docs/images/film.gif.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from shaftpose.core.errors import exit_on_input_error
from shaftpose.core.files import read_json
from shaftpose.core.geometry import ShaftPose
from shaftpose.core.images import resized
from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.figures.markdown import pipe_table
from shaftpose.frame_sources.video_files import VideoFile
from shaftpose.inference.tracker import matches
from shaftpose.inference.tracks import tip_and_axis
from shaftpose.metrics.pose_errors import errors_between
from shaftpose.metrics.table import metrics_named
from shaftpose.report.cells import headings
from studies.moving_shafts import FILM, FPS, POSES
from studies.pages import rewrite, with_tables

ROOT = Path(__file__).parents[1]
PAGE, PICTURE = ROOT / "docs/prediction.md", ROOT / "docs/images/film.gif"
RUNS = {"each frame alone": "alone", "`--track`": "tracked"}
HEADINGS = headings(metrics_named(*POSE_DIMENSIONS))
NEAR_MM = 12.0  # a tip further away belongs to another shaft
EVERY, COLOURS, PICTURE_PX = (
    3,
    96,
    (400, 225),
)  # frames of the film; colours and size of the picture

Array = NDArray[np.float64]
# Frame and shaft -> error (5,), mm and deg.
Errors = dict[tuple[int, int], Array]


def main() -> None:
    """Write the table and the picture of the command line's folder."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of the film and its predictions")
    folder = parser.parse_args().folder
    with exit_on_input_error():
        tables = {"film": table(folder)}
        rewrite(PAGE, lambda page: with_tables(page, tables, "make film", PAGE.name))
        write_picture(folder / "tracked" / FILM, PICTURE)


def table(folder: Path) -> str:
    """Mean errors, and how much errors change from one frame to the next, with and without
    tracking."""
    true = read_json(folder / POSES, "render the film again")
    rows = []
    for title, name in RUNS.items():
        lines = (folder / name / "predictions.jsonl").read_text().splitlines()
        errors = film_errors(true, [json.loads(line)["instruments"] for line in lines])
        found = f"{len(errors)} of {sum(map(len, true))}"
        mean = np.mean([np.abs(error) for error in errors.values()], axis=0)
        rows.append([title, found, "mean error", *_texts(mean)])
        rows.append([title, found, "change between frames", *_texts(changes(errors))])
    return pipe_table(["Poses", "Found", "Measure", *HEADINGS], rows)


def film_errors(
    true: Sequence[Sequence[Mapping[str, float]]], found: Sequence[Sequence[Mapping[str, Any]]]
) -> Errors:
    """The errors of the shafts that were found, by frame and shaft."""
    errors = {}
    for frame, (shafts, those) in enumerate(zip(true, found, strict=True)):
        known, seen = [_pose(one) for one in shafts], [_pose(one) for one in those]
        pairs = matches(
            [tip_and_axis(one) for one in known], [tip_and_axis(one) for one in seen], NEAR_MM
        )
        for row, shaft in pairs.items():
            one = errors_between(seen[row].as_array()[None], known[shaft].as_array()[None])
            errors[frame, shaft] = one.differences[0]
    return errors


def changes(errors: Errors) -> Array:
    """(5,) root mean squares of the changes of errors between successive frames."""
    found = [
        errors[after] - errors[before]
        for before, after in pairwise(sorted(errors, key=lambda key: key[::-1]))
        if after == (before[0] + 1, before[1])
    ]
    return np.asarray(np.sqrt(np.mean(np.square(found), axis=0)))


def _pose(stated: Mapping[str, float]) -> ShaftPose:
    return ShaftPose(**{name: stated[name] for name in POSE_DIMENSIONS})


def _texts(values: Array) -> list[str]:
    return [f"{value:.2f}" for value in values]


def write_picture(film: Path, picture: Path) -> None:
    """Write every few frames of a film as an animated GIF."""
    shown = list(VideoFile(film).frames())[::EVERY]
    frames = [Image.fromarray(resized(frame.rgb, *PICTURE_PX)) for frame in shown]
    # One palette for all: what stays alike from frame to frame takes no bytes.
    palette = frames[0].quantize(COLOURS)
    drawn = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    drawn[0].save(
        picture, save_all=True, append_images=drawn[1:], duration=round(1000 * EVERY / FPS), loop=0
    )


if __name__ == "__main__":
    main()
