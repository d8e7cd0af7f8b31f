"""`shaftpose models`: the models that come with the package."""

import argparse
from dataclasses import replace

from shaftpose.inference.model_files import CARD_SUFFIX, bundled_model, bundled_names
from shaftpose.inference.predictor import Predictor


def run(_options: argparse.Namespace) -> None:
    """Print where each model is, what its file states, and its card."""
    for name in bundled_names():
        path = bundled_model(name)
        predictor = Predictor(path)
        print(f"name: {name}")
        print(f"file: {path}, {path.stat().st_size / 1e6:.1f} MB, SHA-256 as recorded")
        print(f"image: {predictor.side_px} x {predictor.side_px} px")
        metadata = replace(predictor.metadata, edge_reader=None)  # a second model, no text
        for key, value in metadata.as_text().items():
            print(f"{key}: {value}")
        print(f"\n{path.with_suffix(CARD_SUFFIX).read_text()}")
