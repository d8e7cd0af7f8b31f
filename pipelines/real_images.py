"""Stage `real_images`: images with boxes but no poses, the user's or a rendered stand-in."""

import logging
import shutil
from itertools import islice
from pathlib import Path
from typing import Any

from render import CLEAR, OCCLUDED, by_path, images_per_shard
from results import write_json
from settings import cluster_settings, render_settings, size
from stage import SCRATCH, Config, stage

from shaftpose.backgrounds.library import procedural_sources, read_library, write_library
from shaftpose.backgrounds.tissue import STAND_IN
from shaftpose.backgrounds.variations import VariationRanges
from shaftpose.config import RenderSettings
from shaftpose.dataset.coco import RealSample, check_masks, read_coco, read_pixels, write_coco
from shaftpose.errors import InputError
from shaftpose.files import new_file
from shaftpose.images import write_jpeg
from shaftpose.rendering.cluster import connect
from shaftpose.rendering.jobs import RenderedSet
from shaftpose.rendering.locks import alone_in
from shaftpose.rendering.scale_out import render_set
from shaftpose.shards import ShardedDataset

logger = logging.getLogger(__name__)

STAND_IN_FOLDER = SCRATCH / "stand-in"
# Seeds of the stand-in's sets, relative to that of the project, and their share of occluded images.
STAND_IN_SETS = {"train": (2_000_001, 0.3), "clear": (2_000_002, 0.0), "occluded": (2_000_003, 1.0)}
SOURCES_PER_SET = 20


@stage
def main(config: Config) -> None:
    """Write `images/`, `train.json`, `test.json` and `about.json` to `out`."""
    out = Path(config["out"])
    source = config["real"]["source"]
    domain = "stand-in" if source is None else "real"
    with alone_in(out, SCRATCH):
        out.mkdir(parents=True, exist_ok=True)
        if source is None:
            write_stand_in(config, out)
        else:
            copy_real(Path(source), out)
        write_json(out / "about.json", {"domain": domain})
    counts = {part: len(read_coco(out / f"{part}.json")) for part in PARTS}
    logger.info("%s images %s are in %s", domain, counts, out)


PARTS = ("train", "test")


def copy_real(source: Path, out: Path) -> None:
    """Copy the user's images and COCO files; a damaged one ends the stage, not a training."""
    train, test = [read_coco(source / f"{part}.json") for part in PARTS]
    check_masks(test, source / "test.json")
    shared = {image.path for image in train} & {image.path for image in test}
    if shared:
        raise InputError(
            f"{source}: {min(shared).name} is in train.json and in test.json; "
            "keep it in one of them"
        )
    for image in train + test:
        read_pixels(image)
        with new_file(out / image.path.relative_to(source)) as target:
            shutil.copyfile(image.path, target)
    for part in PARTS:
        with new_file(out / f"{part}.json") as target:
            shutil.copyfile(source / f"{part}.json", target)


def write_stand_in(config: Config, out: Path) -> None:
    """Render a domain that looks unlike the training images: other tissue, light, lens and air."""
    samples = render_stand_in(config)
    for name, sample in [pair for pairs in samples.values() for pair in pairs]:
        write_jpeg(sample.rgb, out / name)
    about = "stand-in for real endoscopic images, rendered; boxes only, no poses"
    write_coco(out / "train.json", samples["train"], with_masks=False, description=about)
    test = samples["clear"] + samples["occluded"]
    write_coco(out / "test.json", test, with_masks=True, description=about)


def render_stand_in(config: Config) -> dict[str, list[tuple[str, RealSample]]]:
    """The samples of each set of the stand-in and the names of their image files."""
    cluster = cluster_settings(config)
    samples = {}
    # A second run would repaint the backgrounds that the first one reads.
    with alone_in(STAND_IN_FOLDER, SCRATCH), connect(cluster) as client:
        for name, rendered in stand_in_sets(config).items():
            folder = STAND_IN_FOLDER / name
            render_set(rendered, SCRATCH, folder, client, cluster.hang_s)
            samples[name] = [(f"images/{name}-{key}.jpg", s) for key, s in read_samples(folder)]
    return samples


def stand_in_sets(config: Config) -> dict[str, RenderedSet]:
    """The sets of the stand-in by name; no background is in two of them."""
    sizes = size(config)
    images = {"train": sizes.real, "clear": sizes.test_set, "occluded": sizes.test_set}
    backgrounds = iter(stand_in_backgrounds(config))
    return {
        name: RenderedSet(
            settings=stand_in_settings(config, hidden),
            backgrounds=dict(islice(backgrounds, SOURCES_PER_SET)),
            seed=config["seed"] + seed,
            images=images[name],
            images_per_shard=images_per_shard(images[name], sizes),
        )
        for name, (seed, hidden) in STAND_IN_SETS.items()
    }


def stand_in_backgrounds(config: Config) -> list[tuple[Path, str]]:
    """Tissue of the stand-in's own look, in scratch: image file, id of its source."""
    folder, side_px = STAND_IN_FOLDER / "backgrounds", config["camera"]["size_px"]
    seed = config["seed"] + STAND_IN_SETS["train"][0]
    count = SOURCES_PER_SET * len(STAND_IN_SETS)
    unaltered = VariationRanges((0.0, 0.0), (1.0, 1.0), (1.0, 1.0))
    sources = procedural_sources(count, seed, side_px, STAND_IN)
    write_library(sources, folder, 1, unaltered, seed, side_px, count)
    return list(by_path(read_library(folder)).items())


def stand_in_settings(config: Config, hidden: float) -> RenderSettings:
    """The stand-in's look; `hidden` is the share of images with occluders, 0 for a clear set."""
    look: dict[str, dict[str, Any]] = config["real"]["stand_in"]
    occlusion = OCCLUDED | {"occluder_probability": hidden} if hidden else CLEAR
    # COCO files do not state a camera: all of these images have the one that silhouettes take.
    ranges = config["lens"]["distortion"]
    middle = {name: [sum(ends) / 2] * 2 for name, ends in ranges.items()}
    scene, lens = {**look["scene"], **occlusion}, {**look["lens"], "distortion": middle}
    return render_settings(config, scene=scene, lens=lens)


def read_samples(folder: Path) -> list[tuple[str, RealSample]]:
    """Key and image with boxes and masks, of all images of a rendered set; no poses."""
    shards = ShardedDataset(folder)
    samples = []
    for key in shards.keys:
        sample = RealSample(
            rgb=shards.rgb(key),
            boxes=shards.annotations(key).boxes,
            masks=tuple(shards.masks(key)),
            occluded=bool(shards.facts(key)["occluders"]),
        )
        samples.append((key, sample))
    return samples


if __name__ == "__main__":
    main()
