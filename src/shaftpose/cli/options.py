"""The options of the commands."""

import argparse
import math
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import get_args

from shaftpose.inference.model_files import bundled_names
from shaftpose.settings.choices import Backend, Refinement

_PREDICT_EXAMPLES = """\
examples:
  shaftpose predict frame.png
  shaftpose predict frames/ operation.mp4 --out found --draw
  shaftpose predict operation.mp4 --camera cam.yaml --diameter-mm 5 --format csv > poses.csv
  shaftpose predict 0 --view-deg 70 --diameter-mm 3       # the first camera
  find . -name '*.png' | shaftpose predict - --score 0.3
  shaftpose predict frames/ --out found --workers 16      # 16 processes
  shaftpose predict long.mp4 --start 1:02:30 --every 5 --out found
  shaftpose predict long.mp4 --start 1:02:30 --every 5 --out found --resume    # after Ctrl-C

A camera or stream is read until Ctrl-C; frames that come too fast are skipped.

Exit status: 0; 1 if a source failed (the others are predicted all the same); 130 after Ctrl-C."""


def parser() -> argparse.ArgumentParser:
    """The parser of `shaftpose`'s arguments."""
    root = argparse.ArgumentParser(
        "shaftpose",
        description="Find the shafts of surgical instruments in endoscope images, with their poses",
    )
    root.add_argument("--version", action="version", version=f"shaftpose {version('shaftpose')}")
    commands = root.add_subparsers(dest="command", required=True)
    for name, (summary, examples, add_options) in _COMMANDS.items():
        add_options(
            commands.add_parser(
                name, help=summary, description=summary, epilog=examples,
                formatter_class=argparse.RawDescriptionHelpFormatter,
            )
        )  # fmt: skip
    return root


def _add_predict(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "sources", nargs="+", metavar="SOURCE",
        help="image file, folder of images, video file, camera index, stream URL, or - to read "
        "such names from standard input, one a line",
    )  # fmt: skip
    _add_model(parser)
    parser.add_argument(
        "--score", type=float, help="least score (default: the model's own threshold)"
    )
    parser.add_argument(
        "--refine", choices=get_args(Refinement), default="edges",
        help="how poses are refined: none: not at all; mask: fitted to the model's mask, if it has "
        "one; edges (default, most precise): fitted to the mask, then to the edges in the image; "
        "views: means over the image and its seven mirrored and turned copies, ten times as slow",
    )  # fmt: skip
    parser.add_argument(
        "--backend", choices=get_args(Backend), default="onnxruntime",
        help="the program that runs the model (default: onnxruntime); openvino needs the extra of "
        "that name",
    )  # fmt: skip
    camera = parser.add_mutually_exclusive_group()
    camera.add_argument(
        "--camera", type=Path, help="the camera: a calibration file of OpenCV or ROS"
    )
    camera.add_argument(
        "--view-deg", type=float,
        help="the camera: the angle across its central square, if it has no distortion",
    )  # fmt: skip
    parser.add_argument(
        "--diameter-mm", type=float,
        help="diameter of your shafts, by which x, y and z are scaled (default: that of the "
        "model's shafts, and poses are marked as not metric)",
    )  # fmt: skip
    parser.add_argument(
        "--crop", type=_crop, metavar="X,Y,W,H",
        help="use only this part of each frame, such as one eye of a stereo video: x, y, width, "
        "height; --camera then describes the part (default: the whole frame)",
    )  # fmt: skip
    parser.add_argument(
        "--start", type=_seconds, default=0.0, metavar="TIME",
        help="where films begin, in s or as [HOURS:]MINUTES:SECONDS (default: 0)",
    )  # fmt: skip
    parser.add_argument(
        "--end", type=_seconds, default=math.inf, metavar="TIME",
        help="where films end (default: their end)",
    )  # fmt: skip
    parser.add_argument(
        "--every", type=_positive, default=1, metavar="N",
        help="use only each N-th frame of films (default: 1)",
    )  # fmt: skip
    parser.add_argument(
        "--track", action="store_true",
        help="number the shafts of videos, streams and folders of frames, and smooth their poses",
    )  # fmt: skip
    parser.add_argument(
        "--format", choices=("jsonl", "csv", "bop"), default="jsonl",
        help="of results (default: jsonl)",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, help="folder for results (default: standard output)")
    parser.add_argument(
        "--resume", action="store_true",
        help="continue an interrupted run with the same sources and options: skip what the results "
        "in --out hold",
    )  # fmt: skip
    parser.add_argument("--draw", action="store_true", help="also draw the frames, into --out")
    parser.add_argument(
        "--rerun", action="store_true", help="also write a recording for Rerun's viewer, into --out"
    )
    parser.add_argument(
        "--workers", type=_workers, metavar="N|tcp://HOST:PORT",
        help="spread images over N processes, or the workers of a running Dask scheduler",
    )  # fmt: skip


def _add_demo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out", type=Path, default=Path("shaftpose_demo"), help="folder (default: shaftpose_demo)"
    )


def _add_show(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("what", choices=("dataset", "backgrounds"))
    parser.add_argument("folder", type=Path, help="of shards, real images or backgrounds")
    parser.add_argument("--out", type=Path, required=True, help="the JPEG file to write")
    parser.add_argument(
        "--count", type=_positive, default=20, help="number of images, at most 500 (default: 20)"
    )
    parser.add_argument("--columns", type=_positive, default=5, help="images in a row (default: 5)")


def _add_real(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=("fetch",))
    parser.add_argument("folder", type=Path, help="output folder, for real.source in params.yaml")


def _add_check(parser: argparse.ArgumentParser) -> None:
    _add_model(parser)
    parser.add_argument(
        "--camera", type=Path, help="also check this calibration file of OpenCV or ROS"
    )


def _add_model(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--model",
        help="a model of the package (see `shaftpose models`), an ONNX file, or mlflow:/NAME@ALIAS "
        "of a registry (default: shaftpose)",
    )


def _add_models(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "name", nargs="?", choices=bundled_names(),
        help="describe this model (default: a table of all)",
    )  # fmt: skip


# Command, a module of `shaftpose.cli` -> its summary, examples and options.
_COMMANDS: dict[str, tuple[str, str, Callable[[argparse.ArgumentParser], None]]] = {
    "demo": (
        "predict the image and the film that come with the package",
        "example: shaftpose demo --out look",
        _add_demo,
    ),
    "predict": (
        "find shafts and their poses in images and videos",
        _PREDICT_EXAMPLES,
        _add_predict,
    ),
    "models": (
        "list the models that come with the package, or describe one",
        "example: shaftpose models shaftpose",
        _add_models,
    ),
    "show": (
        "draw a contact sheet of a folder",
        "example: shaftpose show dataset data/render/images --out look.jpg",
        _add_show,
    ),
    "real": (
        "download public endoscopic images, annotated by this project",
        "example: shaftpose real fetch ../endoscopic",
        _add_real,
    ),
    "check": (
        "test whether this machine can predict, and what a camera sees",
        "example: shaftpose check --camera cam.yaml --model models/e/model.onnx",
        _add_check,
    ),
}


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number} is not above 0")
    return number


def _seconds(text: str) -> float:
    parts = text.split(":")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = [-1.0]
    seconds = sum(number * 60**n for n, number in enumerate(reversed(numbers)))
    if len(parts) > 3 or not all(0 <= number < math.inf for number in numbers):
        raise argparse.ArgumentTypeError(f"{text} is no time, such as 90.5 or 1:30.5")
    return seconds


def _crop(text: str) -> tuple[int, int, int, int]:
    numbers = text.split(",")
    if len(numbers) != 4 or not all(number.isdecimal() for number in numbers):
        raise argparse.ArgumentTypeError(f"{text} is not X,Y,W,H, four whole numbers")
    x, y, width, height = map(int, numbers)
    return x, y, width, height


def _workers(text: str) -> int | str:
    return text if "://" in text else _positive(text)
