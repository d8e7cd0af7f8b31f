"""A rendered set: everything that determines its images, and their shards."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

from shaftpose.core.samples import sample_key
from shaftpose.core.shard_index import holds
from shaftpose.core.shard_writer import shard_name
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.settings.parsing import to_json
from shaftpose.settings.schema import RenderSettings
from shaftpose.source_code import source_files

# The modules that create the images and write them.
MODULES = ("shaftpose.rendering.generator", "shaftpose.core.shard_writer")


@dataclass(frozen=True)
class RenderedSet:
    """Images 0 .. images - 1 of one dataset.

    backgrounds: image file -> id of its source, in a fixed order.
    """

    settings: RenderSettings
    backgrounds: Mapping[Path, str]
    seed: int
    images: int
    images_per_shard: int

    def fingerprint(self) -> str:
        """Hexadecimal digest of everything that determines the shards: settings, seed, counts, the
        instrument's mesh, the backgrounds' bytes and `software`.

        Raises InputError if the settings' CAD file cannot be used.
        """
        digest = hashlib.sha256(to_json(self.settings).encode())
        digest.update(f"{self.seed} {self.images} {self.images_per_shard}".encode())
        mesh = instrument_shape(self.settings.shaft).mesh
        digest.update(mesh.vertices.tobytes() + mesh.edges.tobytes())
        digest.update(software().encode())
        for path, source in self.backgrounds.items():
            digest.update(f"{path.name} {source}".encode() + path.read_bytes())
        return digest.hexdigest()[:16]

    def shards(self, folder: Path) -> list["Shard"]:
        """All shards, as files of `folder`."""
        starts = range(0, self.images, self.images_per_shard)
        return [
            Shard(
                path=folder / shard_name(number),
                first=start,
                count=min(self.images_per_shard, self.images - start),
            )
            for number, start in enumerate(starts)
        ]


@cache
def software() -> str:
    """Hexadecimal digest of the software that determines the images: the code, and the versions of
    Blender and of the libraries that produce shapes and pixels."""
    digest = hashlib.sha256()
    for package in ("bpy", "opencv-python-headless", "numpy", "trimesh"):
        digest.update(f"{package} {version(package)}".encode())
    for path in source_files(MODULES):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Shard:
    """`count` consecutive images from `first`, to be written to `path`."""

    path: Path
    first: int
    count: int

    @property
    def log(self) -> Path:
        """The file for Blender's output."""
        return self.path.with_suffix(".log")

    def is_finished(self) -> bool:
        """Whether the shard exists and holds exactly its images."""
        keys = (sample_key(index) for index in range(self.first, self.first + self.count))
        return self.path.exists() and holds(self.path, keys)
