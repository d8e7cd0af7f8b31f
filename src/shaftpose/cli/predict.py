"""`shaftpose predict`: poses of the shafts in images, videos and streams."""

import argparse
import hashlib
import os
import shlex
import sys
from collections.abc import Iterable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from functools import cache, partial
from io import TextIOWrapper
from pathlib import Path
from typing import NoReturn

from tqdm import tqdm

from shaftpose.core.errors import InputError, printable
from shaftpose.frame_sources.frames import Frame, Source
from shaftpose.frame_sources.video_files import Span
from shaftpose.inference.annotated_files import annotated_files
from shaftpose.inference.chunk_worker import PredictedImage, versions
from shaftpose.inference.earlier_results import Earlier, continued
from shaftpose.inference.formats import format_of_run
from shaftpose.inference.image_chunks import predicted_images
from shaftpose.inference.loading import FinderOptions
from shaftpose.inference.model_files import REGISTRY, model_file
from shaftpose.inference.prediction_run import Write, for_each_frame, is_live, outputs, sources
from shaftpose.inference.result_stream import result_stream, results_file
from shaftpose.inference.run_record import RunRecord, run_record
from shaftpose.inference.shaft_finder import ShaftFinder
from shaftpose.inference.tracker import ShaftTracker

# Options that must be the same when a run is resumed; of --model and --camera, the files must.
_DECISIVE = (
    "view_deg", "diameter_mm", "crop", "score", "refine", "backend", "start", "end", "every",
    "track", "draw", "format",
)  # fmt: skip


def run(options: argparse.Namespace) -> None:
    """Write the shafts of each frame, and draw them if asked.

    Raises InputError if options do not go together, and at the end if a source failed.
    """
    _check(options)
    failed = (_predict_alone if options.workers is None else _predict_on_workers)(options)
    if options.out is not None:
        print(f"results are in {printable(str(options.out))}")
    if failed:
        raise InputError(f"sources that failed, see above: {failed}")


def _check(options: argparse.Namespace) -> None:
    """Raise InputError if options do not go together."""
    if options.draw and options.out is None:
        raise InputError("--draw: needs a folder for the pictures; name one by --out")
    if options.rerun and options.out is None:
        raise InputError("--rerun: needs a folder for the recording; name one by --out")
    if options.start >= options.end:
        raise InputError(f"--start {options.start:g} s is not before --end {options.end:g} s")
    if options.resume and (options.out is None or options.rerun or options.format == "bop"):
        raise InputError("--resume: needs --out, and continues no --rerun and no --format bop")
    if options.resume and options.draw and options.format == "csv":
        raise InputError(
            "--resume: with --draw, needs --format jsonl: a table has no row of a frame without "
            "shafts, so that nobody can tell whether it was drawn"
        )
    if options.resume and (live := [name for name in options.sources if is_live(name)]):
        raise InputError(f"--resume: {live[0]} is live and cannot be continued; leave out --resume")


def _predict_alone(options: argparse.Namespace) -> int:
    """Predict all sources in this process. Returns the number of sources that failed."""
    warn_once = cache(warn)
    with model_file(options.model) as model:
        finder = replace(_finder_options(options), model=str(model)).finder(warn_once)
        named, record = named_sources(options), _record(options, model)
    earlier = _earlier(options)
    tracker = ShaftTracker(finder.axis_px, finder.diameter_mm) if options.track else None
    style = format_of_run(options.format)
    drawings = annotated_files(options.out, earlier.again, record) if options.draw else None
    recording = _recording(options.out, finder) if options.rerun else None
    with (
        outputs(options.out, style, drawings, recording, options.resume) as write,
        progress_bar(named, earlier.count, options.out is None) as bar,
    ):

        def predict(frame: Frame) -> None:
            shafts = finder(frame.rgb, frame.source, frame.aspect)
            write(frame, shafts if tracker is None else tracker(frame, shafts))
            bar.update()

        return for_each_frame(earlier.rest(named), predict, report, warn_once)


def _predict_on_workers(options: argparse.Namespace) -> int:
    """Predict images on Dask workers. Returns the number of sources that failed.

    Raises InputError if Dask is missing, the scheduler does not answer, an option needs the frames
    in this process, or the model of a registry is to be used on other machines.
    """
    if options.draw or options.rerun or options.track:
        raise InputError("--draw, --rerun, --track: not with --workers; leave out one or the other")
    if isinstance(options.workers, str) and (options.model or "").startswith(REGISTRY):
        raise InputError(
            f"--model {options.model}: not with the workers of {options.workers}; download it to a "
            "path that all machines share, and name that file"
        )
    try:
        from shaftpose.farm.ordered_tasks import in_order
        from shaftpose.farm.workers import client_of
    except ImportError as error:
        raise InputError("--workers: needs Dask: in a clone, pip install '.[cluster]'") from error
    style = format_of_run(options.format)
    with model_file(options.model) as model, ExitStack() as stack:
        chosen = _absolute(_finder_options(options), model)
        chosen.finder(warn)  # so that unusable options end the command here
        client = stack.enter_context(client_of(options.workers))  # one that fails leaves no file
        named, _ = named_sources(options), _record(options, model)
        earlier = _earlier(options)
        with (
            result_stream(options.out, style, options.resume) as results,
            progress_bar(named, earlier.count, options.out is None) as bar,
        ):

            def write(image: PredictedImage) -> None:
                results.add(image, image.shafts)
                bar.update()

            images = predicted_images(earlier.rest(named), chosen, partial(in_order, client), warn)
            return for_each_frame(images, write, report, warn)


def _recording(folder: Path, finder: ShaftFinder) -> AbstractContextManager[Write]:
    """A recording for Rerun's viewer. Raises InputError if Rerun is missing."""
    try:
        from shaftpose.inference.rerun_file import rerun_file
    except ImportError as error:
        raise InputError("--rerun: needs Rerun: in a clone, pip install '.[rerun]'") from error
    return rerun_file(folder, finder.camera_matrix, finder.diameter_mm)


def _record(options: argparse.Namespace, model: Path) -> RunRecord | None:
    """The record of a run in a folder: what decides its results, files by their content."""
    if options.out is None:
        return None
    decisive = {"--model": _digest(model)}
    decisive["--camera"] = str(options.camera and _digest(options.camera))
    for name in _DECISIVE:
        decisive[f"--{name.replace('_', '-')}"] = str(getattr(options, name))
    software = versions(options.backend)
    decisive["the software"] = ", ".join(f"{name} {version}" for name, version in software)
    decisive["the sources"] = shlex.join(options.sources)
    if not all(os.path.isabs(name) or "://" in name for name in options.sources):
        decisive["the working directory"] = os.getcwd()
    results = results_file(options.out, format_of_run(options.format))
    return run_record(results, decisive, options.resume)


def _digest(path: Path) -> str:
    """The beginning of a file's SHA-256. Raises InputError naming the file if it is missing."""
    try:
        return f"sha256:{hashlib.sha256(path.read_bytes()).hexdigest()[:16]}"
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def _earlier(options: argparse.Namespace) -> Earlier:
    """The frames that an interrupted run has finished, if it is to be resumed."""
    if not options.resume:
        return Earlier({})
    path = results_file(options.out, format_of_run(options.format))
    return continued(path, options.format, options.track, options.draw)


def _finder_options(options: argparse.Namespace) -> FinderOptions:
    return FinderOptions(
        options.model, options.camera, options.view_deg, options.diameter_mm, options.crop,
        options.score, options.refine, options.backend,
    )  # fmt: skip


def _absolute(options: FinderOptions, model: Path) -> FinderOptions:
    """The options with absolute paths, for a process in another folder."""
    camera = None if options.camera is None else options.camera.absolute()
    return replace(options, model=str(model.absolute()), camera=camera)


def named_sources(options: argparse.Namespace) -> Iterable[Source]:
    """The sources: a list, or an iterator if standard input names some."""
    names, span = options.sources, Span(options.start, options.end, options.every)
    if "-" in names and isinstance(sys.stdin, TextIOWrapper):
        sys.stdin.reconfigure(errors="surrogateescape")  # as in the words of the command line
    drawings = options.out if options.draw else None
    found = sources(names, sys.stdin or (), span, warn, drawings)
    return found if "-" in names else list(found)


def progress_bar(named: Iterable[Source], done: int, hidden: bool) -> "tqdm[NoReturn]":
    """A progress bar over all frames, on a terminal.

    done: frames of an earlier run. hidden: no bar if the terminal shows results.
    """
    total = None
    if isinstance(named, list):
        lengths = [source.length for source in named]
        total = None if None in lengths else sum(filter(None, lengths))
    disable = True if total == 1 or (hidden and sys.stdout.isatty()) else None
    return tqdm(total=total, initial=done, unit="frame", disable=disable)


def warn(message: str) -> None:
    """Print a warning to standard error, above the progress bar if there is one."""
    tqdm.write(f"warning: {printable(message)}", file=sys.stderr)


def report(message: str) -> None:
    """Print an error that does not end the command."""
    tqdm.write(f"error: {printable(message)}", file=sys.stderr)
