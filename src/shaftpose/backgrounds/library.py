"""The background library: source images, real or procedural, and their colour variations on disk.

A library is a folder of square JPEG files and an `index.csv` that tells for each file its source
image and how its colours were altered.
"""

import csv
import logging
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

from shaftpose.backgrounds.tissue import TissueLook, render_tissue
from shaftpose.backgrounds.variations import (
    UNALTERED,
    Variation,
    VariationRanges,
    sample_variation,
    vary_colour,
)
from shaftpose.errors import InputError
from shaftpose.files import new_file
from shaftpose.images import Image, centre_square, read_rgb, write_jpeg

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"})
INDEX_NAME = "index.csv"
INDEX_COLUMNS = ("file", "source", "hue_deg", "saturation", "brightness")
JPEG_QUALITY = 95

log = logging.getLogger(__name__)


@dataclass
class SourceImages:
    """The images of a folder, decoded one at a time while they are iterated over.

    Iterating yields (id, RGB image). The id is the file's name, or that of the subfolder which it
    lies in: frames of one operation are alike, and images of one id stay together in a split. Files
    that cannot be read or decoded are passed over and collected in `skipped`, which is complete
    when the iteration is.
    """

    folder: Path
    paths: tuple[Path, ...]
    _skipped: list[Path] = field(default_factory=list, init=False, repr=False)

    @property
    def skipped(self) -> tuple[Path, ...]:
        """The files of the last iteration that could not be read or decoded."""
        return tuple(self._skipped)

    def __len__(self) -> int:
        """The number of image files, unreadable ones included."""
        return len(self.paths)

    def __iter__(self) -> Iterator[tuple[str, Image]]:
        self._skipped.clear()
        for path in self.paths:
            try:
                image = read_rgb(path)
            except InputError as error:
                self._skipped.append(path)
                log.warning("skipped %s", error)
            else:
                yield path.relative_to(self.folder).parts[0], image
        if len(self._skipped) == len(self.paths):
            raise InputError(
                f"none of the {len(self.paths)} images in {self.folder} can be read and "
                "decoded: replace them with intact PNG, JPEG, BMP or TIFF files"
            )


def read_source_images(folder: Path) -> SourceImages:
    """The image files beneath `folder`, sorted by relative path; nothing is decoded yet."""
    if not folder.is_dir():
        raise InputError(f"background folder {folder} does not exist: create it and put images in")
    found = [path for path in folder.rglob("*") if _is_image_file(path)]
    if not found:
        raise InputError(
            f"background folder {folder} holds no images: add PNG, JPEG, BMP or TIFF files"
        )
    return SourceImages(folder, tuple(sorted(found, key=lambda path: path.as_posix())))


def _is_image_file(path: Path) -> bool:
    return path.suffix.lower() in IMAGE_SUFFIXES and path.is_file()


def procedural_sources(
    count: int, seed: int, size_px: int, look: TissueLook
) -> Iterator[tuple[str, Image]]:
    """`count` (id, RGB image) of rendered tissue; image k depends on (seed, k) only."""
    for number in range(count):
        rng = np.random.default_rng(np.random.SeedSequence([seed, number]))
        yield f"tissue-{number:06d}", render_tissue(rng, size_px, look)


def write_library(
    sources: Iterable[tuple[str, Image]],
    out: Path,
    variations: int,
    ranges: VariationRanges,
    seed: int,
    size_px: int,
    total: int,
) -> None:
    """Write `variations` squares of each source (id, RGB image), the first one unaltered.

    `total` sources are expected, for the progress bar. The index comes last, so that a library
    with an index is complete.
    """
    if variations < 1:
        raise InputError(f"variations per background is {variations}: set it to 1 or more")
    out.mkdir(parents=True, exist_ok=True)
    (out / INDEX_NAME).unlink(missing_ok=True)
    rows: list[tuple[str, ...]] = []
    for number, (source, image) in enumerate(tqdm(sources, "backgrounds", total, unit="image")):
        square = centre_square(image, size_px)
        for variation in _variations(number, variations, ranges, seed):
            name = f"{len(rows):06d}.jpg"
            write_jpeg(_varied(square, variation), out / name, JPEG_QUALITY)
            rows.append((name, source, *_as_row(variation)))
    _write_index(out / INDEX_NAME, rows)


def _write_index(path: Path, rows: list[tuple[str, ...]]) -> None:
    with new_file(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        index = csv.writer(stream, lineterminator="\n")
        index.writerow(INDEX_COLUMNS)
        index.writerows(rows)


def _variations(
    source_number: int, count: int, ranges: VariationRanges, seed: int
) -> Iterator[Variation]:
    rng = np.random.default_rng(np.random.SeedSequence([seed, source_number]))
    yield UNALTERED
    for _ in range(count - 1):
        yield sample_variation(rng, ranges)


def _varied(image: Image, variation: Variation) -> Image:
    return vary_colour(image, variation.hue_deg, variation.saturation, variation.brightness)


def _as_row(variation: Variation) -> tuple[str, str, str]:
    return (
        f"{variation.hue_deg:.4f}",
        f"{variation.saturation:.4f}",
        f"{variation.brightness:.4f}",
    )


@dataclass(frozen=True)
class Background:
    """One file of a library and the id of the source image that it was made from."""

    path: Path
    source: str


def read_library(folder: Path) -> list[Background]:
    """The backgrounds that `index.csv` in `folder` lists, all of which are there."""
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
    """Two lists that share no source image; the second has `share` of the sources, at least one.

    Raises InputError for fewer than four sources: three must remain, one each for training,
    validation and test images.
    """
    sources = sorted({background.source for background in backgrounds})
    count = max(1, round(share * len(sources)))
    if len(sources) - count < 3:
        raise InputError(
            f"{len(sources)} source image(s), a subfolder counting as one, of which {count} held "
            "out leave fewer than three: give more images in backgrounds.source, or subfolders, or "
            "lower backgrounds.held_out"
        )
    chosen = set(np.random.default_rng(seed).permutation(sources)[:count].tolist())
    kept = [background for background in backgrounds if background.source not in chosen]
    return kept, [background for background in backgrounds if background.source in chosen]
