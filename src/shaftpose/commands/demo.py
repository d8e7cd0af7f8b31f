"""`shaftpose demo`: the package's own model on the package's own image."""

import argparse
from importlib.resources import as_file, files

from shaftpose.deployment.bundled import bundled_model
from shaftpose.deployment.predictor import Predictor
from shaftpose.inference.formats import FORMATS
from shaftpose.inference.frame_cameras import known_camera, stated_view
from shaftpose.inference.image_files import ImageFile
from shaftpose.inference.outputs import outputs
from shaftpose.inference.shaft_finder import ShaftFinder

# The rendered test image with two shafts, its camera and its shafts.
IMAGE, VIEW_DEG, DIAMETER_MM = "demo_frame.jpg", 95.0, 3.0


def run(options: argparse.Namespace) -> None:
    """Write poses and picture into a folder. Raises UnwritableError if it holds results."""
    predictor = Predictor(bundled_model())
    views = known_camera(stated_view(VIEW_DEG), predictor.camera, warn=print)
    finder = ShaftFinder(predictor, views, predictor.confidence, DIAMETER_MM, metric=True)
    with (
        as_file(files("shaftpose.inference") / IMAGE) as image,
        outputs(options.out, FORMATS["jsonl"], options.out) as write,
    ):
        (frame,) = ImageFile(image).frames()
        shafts = finder(frame.rgb)
        write(frame, shafts)
    print(f"{len(shafts)} shafts found: poses and a picture are in {options.out}")
    print("next: shaftpose predict YOUR_IMAGE_OR_VIDEO --out found --draw")
