"""Index of the background library: its files and the source image of each."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from shaftpose.core.errors import InputError

INDEX_NAME = "index.csv"
INDEX_COLUMNS = ("file", "source", "hue_deg", "saturation", "brightness")


@dataclass(frozen=True)
class Background:
    """One file of a library and the id of its source image."""

    path: Path
    source: str


def read_library(folder: Path) -> list[Background]:
    """The backgrounds listed in `folder`/index.csv. Raises InputError if one is missing."""
    index = folder / INDEX_NAME
    if not index.is_file():
        raise InputError(f"{index} does not exist: run `dvc repro backgrounds`")
    with index.open(newline="", encoding="utf-8") as stream:
        rows = csv.DictReader(stream)
        if rows.fieldnames is None or tuple(rows.fieldnames) != INDEX_COLUMNS:
            columns = ",".join(INDEX_COLUMNS)
            raise InputError(f"{index} lacks the columns {columns}: run `dvc repro backgrounds`")
        backgrounds = [Background(folder / row["file"], row["source"]) for row in rows]
    if not backgrounds:
        raise InputError(f"{index} lists no backgrounds: run `dvc repro backgrounds`")
    for background in backgrounds:
        if not background.path.is_file():
            raise InputError(
                f"{background.path} is listed in {index} but missing: run `dvc repro backgrounds`"
            )
    return backgrounds


def hold_out(
    backgrounds: Sequence[Background], share: float, seed: int
) -> tuple[list[Background], list[Background]]:
    """Split backgrounds into two lists without a common source image.

    The second list gets `share` of the sources, at least one. Raises InputError for fewer than four
    sources: three must remain, one each for training, validation and test images.
    """
    sources = sorted({background.source for background in backgrounds})
    count = max(1, round(share * len(sources)))
    if len(sources) - count < 3:
        raise InputError(
            f"{len(sources)} source image(s) (a subfolder counts as one), {count} of them held out,"
            " leave fewer than three: add images or subfolders to backgrounds.source, or lower "
            "backgrounds.held_out"
        )
    chosen = set(np.random.default_rng(seed).permutation(sources)[:count].tolist())
    kept = [background for background in backgrounds if background.source not in chosen]
    return kept, [background for background in backgrounds if background.source in chosen]
