"""The background library: source images, real or procedural, and their colour variations on disk.

A library is a folder of square JPEG files and an `index.csv` that lists the source image and the
colour variation of each file.
"""

import logging
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from tqdm import tqdm

from shaftpose.backgrounds.tissue import MUCOSA, TissueLook, render_tissue
from shaftpose.backgrounds.variations import VariationRanges, sample_variations, vary_colour
from shaftpose.core.background_index import INDEX_COLUMNS, INDEX_NAME
from shaftpose.core.errors import InputError
from shaftpose.core.files import write_csv
from shaftpose.core.images import Image, centre_square, write_jpeg
from shaftpose.core.random_streams import streams
from shaftpose.image_files.reading import is_image, read_rgb
from shaftpose.settings.schema import BackgroundSettings

JPEG_QUALITY = 95

log = logging.getLogger(__name__)


def write_backgrounds(
    settings: BackgroundSettings, sources: int, variations: int, side_px: int, seed: int, out: Path
) -> None:
    """Write the library of the settings: `sources` procedural tissues, or all of the user's images.

    Raises InputError if the user's folder holds no readable image.
    """
    ranges = VariationRanges(settings.hue_deg, settings.saturation, settings.brightness)
    if settings.source is None:
        log.info("no image folder given: generating %d procedural tissues", sources)
        tissues = procedural_sources(sources, seed, side_px, MUCOSA)
        write_library(tissues, out, variations, ranges, seed, side_px, sources)
    else:
        folder = Path(settings.source)
        paths = image_files(folder)
        images = decoded_images(folder, paths)
        write_library(images, out, variations, ranges, seed, side_px, len(paths))
    log.info("the backgrounds are in %s", out)


def image_files(folder: Path) -> list[Path]:
    """The image files below a folder, sorted by path. Raises InputError if there are none."""
    if not folder.is_dir():
        raise InputError(f"background folder {folder} does not exist: create it and put images in")
    found = [path for path in folder.rglob("*") if path.is_file() and is_image(path)]
    if not found:
        raise InputError(
            f"background folder {folder} holds no images: add PNG, JPEG, BMP or TIFF files"
        )
    return sorted(found, key=lambda path: path.as_posix())


def decoded_images(folder: Path, paths: Sequence[Path]) -> Iterator[tuple[str, Image]]:
    """Pairs (id, RGB image) of files below `folder`, decoded one at a time.

    The id is the file's name or its subfolder's: frames of one operation are similar, and images
    with one id stay together in a split. Files that cannot be read or decoded are skipped with a
    warning. Raises InputError if all are.
    """
    skipped = 0
    for path in paths:
        try:
            image = read_rgb(path)
        except InputError as error:
            skipped += 1
            log.warning("skipped %s", error)
        else:
            yield path.relative_to(folder).parts[0], image
    if skipped == len(paths):
        raise InputError(
            f"none of the {skipped} images in {folder} can be read and decoded: replace them with "
            "intact PNG, JPEG, BMP or TIFF files"
        )


def procedural_sources(
    count: int, seed: int, size_px: int, look: TissueLook
) -> Iterator[tuple[str, Image]]:
    """`count` pairs (id, RGB image) of rendered tissue; image k depends on (seed, k) only."""
    for number in range(count):
        yield f"tissue-{number:06d}", render_tissue(streams(seed, number), size_px, look)


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

    total: number of sources, for the progress bar. The index is written last, so a library with an
    index is complete.
    """
    out.mkdir(parents=True, exist_ok=True)
    (out / INDEX_NAME).unlink(missing_ok=True)
    rows: list[tuple[str, ...]] = []
    for number, (source, image) in enumerate(
        tqdm(sources, "backgrounds", total, unit="image", disable=None)
    ):
        square = centre_square(image, size_px)
        rng = streams(seed, number)("variations")
        for variation in sample_variations(rng, variations, ranges):
            name = f"{len(rows):06d}.jpg"
            write_jpeg(vary_colour(square, **vars(variation)), out / name, JPEG_QUALITY)
            rows.append((name, source, *(f"{value:.4f}" for value in vars(variation).values())))
    write_csv(out / INDEX_NAME, INDEX_COLUMNS, rows)
