"""The images of a training."""

from dataclasses import dataclass
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.coco import read_coco
from shaftpose.dataset.coco_images import CocoImage
from shaftpose.dataset.colour_transforms import ColourJitter, UniformNoise
from shaftpose.dataset.labelled_images import (
    CocoFrames,
    CocoImages,
    Images,
    ImagesInMemory,
    RenderedImages,
)
from shaftpose.dataset.split import read_keys
from shaftpose.dataset.training_data import TrainingData
from shaftpose.dataset.training_stream import SkippedImages, TrainingStream, Transform
from shaftpose.settings.schema import Augmentation
from shaftpose.training.recipe import Recipe

# Shorter side of frames relative to that of the views of them, which may be enlarged.
_FRAME_DENSITY = 1.5


@dataclass(frozen=True)
class DataFolders:
    """Where the data of a training are.

    rendered: shards; split: lists of the rendered images; mixed_in: COCO files and images without
    poses, real or a stand-in.
    """

    rendered: Path
    split: Path
    mixed_in: Path

    def mixed_in_images(self) -> list[CocoImage]:
        """The training images without poses."""
        return read_coco(self.mixed_in / "train.json")


def training_data(
    recipe: Recipe, folders: DataFolders, skipped: SkippedImages, with_instances: bool = False
) -> TrainingData:
    """Training images, augmented, with a variant's share of those without poses, and validation
    images.

    with_instances: see `RenderedImages`. Raises InputError if random views are to be taken without.
    """
    if recipe.variant.views and not with_instances:
        raise InputError(
            f"variant.views = true: the network of variant {recipe.variant.name} learns no masks, "
            "which random views need; set it to false"
        )
    settings, size, variant = recipe.training, recipe.size, recipe.variant
    shards, side_px = ShardedDataset(folders.rendered), recipe.camera.size_px
    rendered: Images = RenderedImages(shards, read_keys(folders.split, "train"), with_instances)
    mixed_in: Images | None = None
    if variant.real_share > 0 and variant.views:
        frames = folders.mixed_in_images()
        shafts = [shaft for frame in frames for shaft in frame.instruments]
        if shafts and not any(shaft.mask is not None for shaft in shafts):
            raise InputError(
                f"{folders.mixed_in}/train.json: no shaft has a `segmentation`, by which "
                f"{variant.name} learns; outline shafts in real.source, or train d_noise_real"
            )
        mixed_in = CocoFrames(frames, round(_FRAME_DENSITY * side_px))
    elif variant.real_share > 0:
        mixed_in = CocoImages(folders.mixed_in_images(), side_px, with_instances)
    if settings.images_in_memory:
        rendered = ImagesInMemory.of(rendered)
        mixed_in = None if mixed_in is None else ImagesInMemory.of(mixed_in)
    stream = TrainingStream(
        rendered=rendered,
        mixed_in=mixed_in,
        mixed_in_share=variant.real_share,
        transforms=transforms(settings.augmentation, variant.noise),
        length=size.steps * size.batch_size,
        seed=recipe.seed,
        skipped=skipped if settings.on_damaged == "skip" else None,
        symmetries=variant.symmetries,
        view_px=side_px if variant.views else None,
    )
    validation = RenderedImages(shards, read_keys(folders.split, "validation"), with_instances)
    return TrainingData(stream, validation, size.batch_size, settings.loader_workers)


def transforms(augmentation: Augmentation, noise: int) -> list[Transform]:
    """Colour jitter for every variant, and noise if the variant has it."""
    jitter = ColourJitter(**vars(augmentation))
    return [jitter, UniformNoise(noise)] if noise else [jitter]
