"""`shaftpose models`: the model that comes with the package."""

import argparse

from shaftpose.deployment.bundled import bundled_model
from shaftpose.deployment.predictor import Predictor


def run(_options: argparse.Namespace) -> None:
    """Print where the model is, what its file states, and its card."""
    path = bundled_model()
    predictor = Predictor(path)
    print(f"file: {path}, {path.stat().st_size / 1e6:.1f} MB, SHA-256 as recorded")
    print(f"image: {predictor.side_px} x {predictor.side_px} px")
    for name, value in predictor.facts.as_text().items():
        print(f"{name}: {value}")
    print(f"\n{path.with_suffix('.md').read_text()}", end="")
