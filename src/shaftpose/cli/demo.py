"""`shaftpose demo`: the bundled model on the bundled image and film."""

import argparse
from contextlib import ExitStack
from importlib.resources import as_file, files

from shaftpose.cli import predict
from shaftpose.cli.options import parser

# A rendered test image and a rendered film of squares, each with two shafts.
EXAMPLES = ("demo_frame.jpg", "demo_film.mp4")
# Their camera and shafts, and what to write.
OPTIONS = ("--view-deg=95", "--diameter-mm=3", "--track", "--draw")


def run(options: argparse.Namespace) -> None:
    """Write poses, a picture and a film. Raises UnwritableError if the folder holds results."""
    with ExitStack() as stack:
        folder = files("shaftpose.inference")
        paths = [str(stack.enter_context(as_file(folder / name))) for name in EXAMPLES]
        predict.run(parser().parse_args(["predict", *paths, *OPTIONS, f"--out={options.out}"]))
    print("next: shaftpose predict YOUR_IMAGE_OR_VIDEO --out found --draw")
