"""A rendered set as shards of work: what is to be rendered and where finished shards lie.

Finished shards live in a scratch folder whose name is the fingerprint of everything that determines
the images. An interrupted render, run again, therefore continues; a changed setting starts anew.
"""

import hashlib
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path

import shaftpose
from shaftpose.config import RenderSettings, from_json, to_json
from shaftpose.files import new_file
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.shards import holds, sample_key, shard_name

# Code that determines the bytes of a shard, relative to the package.
_SOURCES = ("rendering/*.py", "geometry.py", "shards.py", "images.py")
_SET = "set.json"
_SHARD = re.compile(r"shard-\d{6,}\.tar(\.part)?")  # see `shard_name`; `.part`: a copy begun


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
        mesh, the bytes of the backgrounds, and `software`.

        Raises InputError if the settings name a CAD file that cannot be used.
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
    """Hexadecimal digest of what determines the images besides their set: the code, and the
    versions of Blender and of the libraries that shapes and pixels come from."""
    digest = hashlib.sha256()
    for package in ("bpy", "opencv-python-headless", "numpy", "trimesh"):
        digest.update(f"{package} {version(package)}".encode())
    root = Path(shaftpose.__file__).parent
    for pattern in _SOURCES:
        for path in sorted(root.glob(pattern)):
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
        """Where Blender's chatter goes."""
        return self.path.with_suffix(".log")

    def is_finished(self) -> bool:
        """Whether the shard is there and holds its images."""
        keys = (sample_key(index) for index in range(self.first, self.first + self.count))
        return self.path.exists() and holds(self.path, keys)


def write_set(rendered: RenderedSet, folder: Path) -> None:
    """Put the description of a set beside its shards; `read_set` reads it on any machine."""
    backgrounds = {path.resolve(): source for path, source in rendered.backgrounds.items()}
    settings = _with_absolute_files(rendered.settings)
    described = replace(rendered, settings=settings, backgrounds=backgrounds)
    (folder / _SET).write_text(to_json(described))


def _with_absolute_files(settings: RenderSettings) -> RenderSettings:
    cad = settings.shaft.cad
    if cad is None:
        return settings
    cad = replace(cad, file=cad.file.resolve())
    return replace(settings, shaft=replace(settings.shaft, cad=cad))


def read_set(folder: Path) -> RenderedSet:
    """The set whose shards lie in `folder`."""
    return from_json(RenderedSet, folder / _SET)


def link_shards(shards: Sequence[Shard], out: Path) -> None:
    """Put finished shards into `out` as hard links, or as copies across file systems.

    All shards that were there go first: whenever this is interrupted, some may be missing, but
    those of two sets never lie side by side.
    """
    out.mkdir(parents=True, exist_ok=True)
    for path in out.iterdir():
        if _SHARD.fullmatch(path.name):
            path.unlink()
    for shard in shards:
        _link_or_copy(shard.path, out / shard.path.name)


def _link_or_copy(source: Path, target: Path) -> None:
    """A copy, too, has its final name only when it is whole."""
    try:
        os.link(source, target)
    except OSError:
        with new_file(target) as part:
            shutil.copyfile(source, part)
