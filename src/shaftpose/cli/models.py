"""`shaftpose models`: describes the bundled models."""

import argparse
from dataclasses import replace

from shaftpose.figures.text import aligned
from shaftpose.inference.model_files import CARD_SUFFIX, bundled_model, bundled_names
from shaftpose.inference.predictor import Predictor

COLUMNS = {
    "name": "name", "side_px": "image [px]", "view_deg": "view [deg]",
    "shaft_diameter_mm": "shaft [mm]",
}  # fmt: skip


def run(options: argparse.Namespace) -> None:
    """Print a table of all models, or the file, the metadata and the card of one."""
    if options.name is not None:
        _describe(options.name)
        return
    facts = [{"name": name, **_metadata(name)} for name in bundled_names()]
    print(aligned(list(COLUMNS.values()), ([one.get(key, "") for key in COLUMNS] for one in facts)))
    print("\nshaftpose models NAME describes one: its training data, errors and limits")


def _describe(name: str) -> None:
    path = bundled_model(name)
    print(f"name: {name}")
    print(f"file: {path}, {path.stat().st_size / 1e6:.1f} MB, SHA-256 as recorded")
    for key, value in _metadata(name).items():
        print(f"{key}: {value}")
    print(f"\n{path.with_suffix(CARD_SUFFIX).read_text()}")


def _metadata(name: str) -> dict[str, str]:
    metadata = Predictor(bundled_model(name)).metadata
    return replace(metadata, edge_reader=None).as_text()  # which is no text
