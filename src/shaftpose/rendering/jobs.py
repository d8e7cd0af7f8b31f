"""A rendered set as shards of work: what is to be rendered and where finished shards lie.

Finished shards live in a scratch folder whose name is the fingerprint of everything that determines
the images. An interrupted render, run again, therefore continues; a changed setting starts anew.
"""

import hashlib
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import shaftpose
from shaftpose.config import RenderSettings, to_json
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.shards import shard_name

# Code that determines the bytes of a shard, relative to the package.
_SOURCES = ("rendering/*.py", "geometry.py", "shards.py", "images.py")


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
        """Hexadecimal digest of all that determines the images: settings, seed, the instrument's
        mesh, the bytes of the backgrounds, the code, and the versions of Blender, OpenCV and numpy.

        Raises InputError if the settings name a CAD file that cannot be used.
        """
        digest = hashlib.sha256(to_json(self.settings).encode())
        digest.update(f"{self.seed} {self.images} {self.images_per_shard}".encode())
        mesh = instrument_shape(self.settings.shaft).mesh
        digest.update(mesh.vertices.tobytes() + mesh.edges.tobytes())
        for package in ("bpy", "opencv-python-headless", "numpy"):
            digest.update(f"{package} {version(package)}".encode())
        for path, source in self.backgrounds.items():
            digest.update(f"{path.name} {source}".encode() + path.read_bytes())
        root = Path(shaftpose.__file__).parent
        for pattern in _SOURCES:
            for path in sorted(root.glob(pattern)):
                digest.update(path.read_bytes())
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


@dataclass(frozen=True)
class Shard:
    """`count` consecutive images from `first`, to be written to `path`."""

    path: Path
    first: int
    count: int


def link_shards(shards: Sequence[Shard], out: Path) -> None:
    """Put finished shards into `out` as hard links, or as copies across file systems."""
    out.mkdir(parents=True, exist_ok=True)
    for shard in shards:
        target = out / shard.path.name
        target.unlink(missing_ok=True)
        try:
            os.link(shard.path, target)
        except FileExistsError:  # another run of the same set has just put its shard there
            continue
        except OSError:
            shutil.copyfile(shard.path, target)
