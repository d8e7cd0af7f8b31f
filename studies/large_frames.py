"""The fit's errors with more pixels than the network sees: `make large-frames`.

`python -m studies.large_frames --frames 60` renders frames with three times the network's pixels a
side, on enlarged backgrounds of the test sets in data/backgrounds, finds the shafts with the
package's model, and writes the table of docs/beyond.md.
"""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from shaftpose.core.background_index import read_library
from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.geometry import ShaftPose
from shaftpose.core.images import centre_square, write_jpeg
from shaftpose.core.instruments import Detections
from shaftpose.core.samples import Sample
from shaftpose.figures.markdown import pipe_table
from shaftpose.image_files.reading import read_rgb
from shaftpose.inference.model_files import bundled_model
from shaftpose.inference.predictor import Predictor
from shaftpose.rendering.generator import SampleGenerator
from shaftpose.rendering.image_sets import rendered_sets
from shaftpose.rendering.silhouette import blender_output_hidden
from shaftpose.settings.compose import composed_settings
from shaftpose.settings.schema import RenderSettings
from shaftpose.settings.tree import Settings
from studies.film_results import HEADINGS, Errors, film_errors
from studies.pages import rewrite, with_tables

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/beyond.md"
TIMES = 3
# Name of a run -> whether it sees the frame's own pixels.
RUNS = {"299 px": False, f"{TIMES * 299} px": True}


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=60, help="number of frames (60)")
    frames = parser.parse_args().frames
    with exit_on_input_error():
        tables = {"large_frames": table(composed_settings(ROOT), frames)}
        rewrite(PAGE, lambda page: with_tables(page, tables, "make large-frames", PAGE.name))


def table(settings: Settings, frames: int) -> str:
    """Median and mean errors of the shafts that all runs found, by the pixels that the fit saw.

    Raises InputError if the package's model was trained for another camera than the settings'.
    """
    predictor, true = Predictor(bundled_model()), []
    wanted, trained = settings.camera.view_deg, predictor.metadata.view_deg
    if wanted != trained:
        raise InputError(
            f"params.yaml: camera.view_deg is {wanted:g}, but the package's model was trained for "
            f"{trained:g}; set {trained:g}"
        )
    found: dict[str, list[list[dict[str, Any]]]] = {name: [] for name in RUNS}
    for sample in tqdm(rendered(settings, frames), "rendering", frames, unit="frame", disable=None):
        true.append([asdict(one.pose) for one in sample.instruments])
        square = centre_square(sample.rgb, predictor.side_px)[None]
        for name, fine in RUNS.items():
            (every,) = predictor(square, [sample.rgb] if fine else None)
            found[name].append(poses(every.above(predictor.confidence)))
    errors = {name: film_errors(true, those) for name, those in found.items()}
    return error_table(errors, sum(map(len, true)))


def error_table(errors: Mapping[str, Errors], shafts: int) -> str:
    """Errors of each run on the shafts that all of them found."""
    common = set.intersection(*(set(one) for one in errors.values()))
    rows = []
    for name, found in errors.items():
        values = np.abs([found[key] for key in sorted(common)])
        of_all = {"median": np.median(values, axis=0), "mean": np.mean(values, axis=0)}
        for measure, row in of_all.items():
            texts = [f"{value:.2f}" for value in row]
            rows.append([name, f"{len(common)} of {shafts}", measure, *texts])
    return pipe_table(["Image of the fit", "Shafts", "Error", *HEADINGS], rows)


def rendered(settings: Settings, frames: int) -> Iterator[Sample]:
    """Images of the clear test set's kind, with more pixels."""
    library, held_out = read_library(Path("data/backgrounds")), settings.backgrounds.held_out
    sets = rendered_sets(settings.rendering, settings.size, library, held_out, settings.seed)
    plan = sets["clear"]
    larger = large(plan.settings)
    side_px = larger.camera.size_px
    with TemporaryDirectory() as folder:
        backgrounds = {}
        for path, source in plan.backgrounds.items():
            enlarged = Path(folder) / path.name
            rgb = cv2.resize(read_rgb(path), (side_px, side_px), interpolation=cv2.INTER_CUBIC)
            write_jpeg(np.asarray(rgb, np.uint8), enlarged)
            backgrounds[enlarged] = source
        generator = SampleGenerator(larger, backgrounds, plan.seed)
        for index in range(frames):
            with blender_output_hidden():
                sample = generator.sample(index)
            yield sample


def large(settings: RenderSettings) -> RenderSettings:
    """The settings for a camera with more pixels."""
    camera = replace(settings.camera, size_px=TIMES * settings.camera.size_px)
    scene = replace(settings.scene, min_visible_px=TIMES**2 * settings.scene.min_visible_px)
    return replace(settings, camera=camera, scene=scene)


def poses(found: Detections) -> list[dict[str, float]]:
    """The poses of detections by the names of their dimensions."""
    return [asdict(ShaftPose.from_array(pose)) for pose in found.poses]


if __name__ == "__main__":
    main()
