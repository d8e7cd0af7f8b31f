"""`shaftpose predict`: poses of the shafts in images, videos and streams (options: cli.py)."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from typing import NoReturn

from tqdm import tqdm

from shaftpose.errors import InputError
from shaftpose.inference.formats import FORMATS
from shaftpose.inference.frames import Frame, Source
from shaftpose.inference.loading import load
from shaftpose.inference.outputs import outputs
from shaftpose.inference.prediction_run import for_each_frame
from shaftpose.inference.sources import sources
from shaftpose.inference.tracker import Tracker


def run(options: argparse.Namespace) -> None:
    """Write what is found in each frame, and draw it if asked.

    Raises InputError if a source failed, after all others.
    """
    if options.draw and options.out is None:
        raise InputError("--draw: needs a folder for the pictures; name one by --out")
    finder = load(
        options.model,
        camera=options.camera,
        view_deg=options.view_deg,
        diameter_mm=options.diameter_mm,
        score=options.score,
        refine=options.refine,
        warn=warn,
    )
    named = named_sources(options.sources)
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
