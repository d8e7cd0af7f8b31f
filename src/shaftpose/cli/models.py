"""`shaftpose models`: describes the bundled models."""

import argparse
from dataclasses import replace

from shaftpose.inference.model_files import CARD_SUFFIX, bundled_model, bundled_names
from shaftpose.inference.predictor import Predictor


def run(_options: argparse.Namespace) -> None:
    """Print the file, the metadata and the card of each model."""
    for name in bundled_names():
        path = bundled_model(name)
        predictor = Predictor(path)
        print(f"name: {name}")
        print(f"file: {path}, {path.stat().st_size / 1e6:.1f} MB, SHA-256 as recorded")
        print(f"image: {predictor.side_px} x {predictor.side_px} px")
        metadata = replace(predictor.metadata, edge_reader=None)  # not text
        for key, value in metadata.as_text().items():
            print(f"{key}: {value}")
        print(f"\n{path.with_suffix(CARD_SUFFIX).read_text()}")
