"""`shaftpose predict`: poses of the shafts in images, videos and streams (options: cli.py)."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from typing import NoReturn

from tqdm import tqdm

from shaftpose.commands.model_files import model_file
from shaftpose.deployment.predictor import Predictor
from shaftpose.errors import InputError
from shaftpose.inference.formats import FORMATS
from shaftpose.inference.frame_cameras import (
    Views,
    calibrated,
    known_camera,
    stated_view,
    unknown_camera,
)
from shaftpose.inference.frames import Frame, Source
from shaftpose.inference.outputs import outputs
from shaftpose.inference.prediction_run import for_each_frame
from shaftpose.inference.shaft_finder import ShaftFinder
from shaftpose.inference.sources import sources
from shaftpose.inference.tracker import Tracker


def run(options: argparse.Namespace) -> None:
    """Write what is found in each frame, and draw it if asked.

    Raises InputError if a source failed, after all others.
    """
    if options.draw and options.out is None:
        raise InputError("--draw: needs a folder for the pictures; name one by --out")
    finder, named = shaft_finder(options), named_sources(options.sources)
    tracker = Tracker(finder.axis_px, finder.diameter_mm) if options.track else None
    style, drawings = FORMATS[options.format], options.out if options.draw else None
    with (
        outputs(options.out, style, drawings) as write,
        progress_bar(named, hidden=options.out is None) as bar,
    ):

        def predict(frame: Frame) -> None:
            shafts = finder(frame.rgb)
            write(frame, shafts if tracker is None else tracker(frame, shafts))
            bar.update()

        failed = for_each_frame(named, predict, report)
    if failed:
        raise InputError(f"sources that failed, see above: {failed}")


def named_sources(names: Sequence[str]) -> Iterable[Source]:
    """The sources; a list unless standard input names some."""
    found = sources(names, sys.stdin)
    return found if "-" in names else list(found)


def shaft_finder(options: argparse.Namespace) -> ShaftFinder:
    """The model of the options, for their camera and shafts; warns of what is unknown."""
    with model_file(options.model) as path:
        predictor = Predictor(path, options.refine)
    unknown = what_is_unknown(options, predictor)
    if unknown:
        warn(f"MILLIMETRES ARE NOT METRIC. {' '.join(unknown)}")
    score = predictor.confidence if options.score is None else options.score
    views = frame_views(options, predictor)
    return ShaftFinder(predictor, views, score, options.diameter_mm, metric=not unknown)


def what_is_unknown(options: argparse.Namespace, predictor: Predictor) -> list[str]:
    """What the user has to state before millimetres are right, as sentences."""
    facts, unknown = predictor.facts, []
    if options.camera is None and options.view_deg is None:
        unknown.append(
            f"The model was trained for a camera of {facts.view_deg:g} deg: state yours by "
            "--camera or --view-deg."
        )
    # An instrument from a CAD file has no diameter: the model knows no other instrument.
    if options.diameter_mm is None and facts.shaft_diameter_mm is not None:
        unknown.append(
            f"It was trained for shafts of {facts.shaft_diameter_mm:g} mm: state yours by "
            "--diameter-mm."
        )
    return unknown


def frame_views(options: argparse.Namespace, predictor: Predictor) -> Views:
    """Views of the frames of the options' camera."""
    if options.camera is not None:
        return known_camera(calibrated(options.camera), predictor.camera, warn)
    if options.view_deg is not None:
        return known_camera(stated_view(options.view_deg), predictor.camera, warn)
    return unknown_camera(predictor.camera)


def progress_bar(named: Iterable[Source], hidden: bool) -> "tqdm[NoReturn]":
    """A bar over all frames, on a terminal. hidden: the terminal may show results instead."""
    total = None
    if isinstance(named, list):
        lengths = [source.length for source in named]
        total = None if None in lengths else sum(filter(None, lengths))
    disable = True if total == 1 or (hidden and sys.stdout.isatty()) else None
    return tqdm(total=total, unit="frame", disable=disable)


def warn(message: str) -> None:
    """Print a warning to standard error, above the progress bar if there is one."""
    tqdm.write(f"warning: {message}", file=sys.stderr)


def report(message: str) -> None:
    """Print an error that does not end the command."""
    tqdm.write(f"error: {message}", file=sys.stderr)
