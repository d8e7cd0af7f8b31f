"""A rendered set on disk: its description and its finished shards.

Finished shards are kept in a scratch folder named after the set's fingerprint. So an interrupted
run continues when it is started again, and renders everything again if a setting has changed.
"""

import hashlib
import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from shaftpose.core.files import new_file
from shaftpose.rendering.rendered_set import RenderedSet, Shard
from shaftpose.settings.parsing import to_json
from shaftpose.settings.schema import RenderSettings
from shaftpose.stage_files import read_stage_file

_SET = "set.json"
_SHARD = re.compile(r"shard-\d{6,}\.tar(\.part)?")  # see `shard_name`; `.part`: an unfinished copy


def write_set(rendered: RenderedSet, folder: Path) -> None:
    """Write the description of a set next to its shards, with absolute paths, for `read_set`."""
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
    """The set that `folder` describes. Raises InputError if the description is damaged."""
    return read_stage_file(folder / _SET, RenderedSet, "render the set again")


def record_checksum(shard: Path) -> None:
    """Write the SHA-256 of a finished shard next to it."""
    with new_file(_record(shard)) as part:
        part.write_text(_checksum(shard))


def matches_checksum(shard: Path) -> bool:
    """Whether a finished shard matches its checksum; writes a missing one (of a killed run)."""
    if not _record(shard).is_file():
        record_checksum(shard)
    return _record(shard).read_text() == _checksum(shard)


def _record(shard: Path) -> Path:
    return shard.with_suffix(".sha256")


def _checksum(shard: Path) -> str:
    with shard.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def link_shards(shards: Sequence[Shard], out: Path) -> None:
    """Put finished shards into `out` as hard links, or as copies across file systems.

    Existing shards in `out` are removed first, so that an interruption never leaves shards of two
    sets mixed.
    """
    out.mkdir(parents=True, exist_ok=True)
    for path in out.iterdir():
        if _SHARD.fullmatch(path.name):
            path.unlink()
    for shard in shards:
        _link_or_copy(shard.path, out / shard.path.name)


def _link_or_copy(source: Path, target: Path) -> None:
    """Link or copy a shard; a copy gets its final name only when it is complete."""
    try:
        os.link(source, target)
    except OSError:
        with new_file(target) as part:
            shutil.copyfile(source, part)
