"""Files in pieces of limited size, for machines that take or give back no larger ones."""

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from shaftpose.core.errors import InputError
from shaftpose.core.files import new_file
from shaftpose.network.checkpoint import is_intact

CHECKPOINT_PIECE_BYTES = 15 * 2**20
EXACT_BYTES = 60 * 2**20  # of the largest checkpoint whose convolutions keep 32 bits


def write_pieces(path: Path, folder: Path, most_bytes: int) -> None:
    """Write a file as `NAME.000`, `NAME.001` and so on to a folder, in place of earlier ones."""
    folder.mkdir(parents=True, exist_ok=True)
    for earlier in _pieces(folder, path.name):
        earlier.unlink()
    with path.open("rb") as file:
        for n, data in enumerate(iter(partial(file.read, most_bytes), b"")):
            (folder / f"{path.name}.{n:03}").write_bytes(data)


def join_pieces(folder: Path, path: Path) -> None:
    """Write the file whose pieces are in a folder.

    Raises InputError if there is none, or one is missing before the last.
    """
    pieces = _pieces(folder, path.name)
    if not pieces or pieces[-1].suffix != f".{len(pieces) - 1:03}":
        raise InputError(f"{folder}: lacks pieces of {path.name}; copy all of them again")
    with new_file(path) as part, part.open("wb") as file:
        for piece in pieces:
            file.write(piece.read_bytes())


def _pieces(folder: Path, name: str) -> list[Path]:
    return sorted(folder.glob(f"{name}.[0-9][0-9][0-9]"))


def write_checkpoint_pieces(path: Path, folder: Path) -> None:
    """Write a finished training's checkpoint in pieces: a large one with convolutions of 16 bits,
    whose 11 digits change a weight by at most 0.05 %."""
    if path.stat().st_size <= EXACT_BYTES:
        write_pieces(path, folder, CHECKPOINT_PIECE_BYTES)
        return
    with TemporaryDirectory() as scratch:
        half = Path(scratch) / path.name
        _convert(path, half, torch.float16)
        write_pieces(half, folder, CHECKPOINT_PIECE_BYTES)


def join_checkpoint_pieces(folder: Path, path: Path) -> None:
    """Write the checkpoint whose pieces are in a folder, with weights of 32 bits.

    Raises InputError as `join_pieces` does, and if the last pieces are missing or one is damaged.
    """
    with TemporaryDirectory() as scratch:
        joined = Path(scratch) / path.name
        join_pieces(folder, joined)
        if not is_intact(joined):
            raise InputError(
                f"{folder}: the pieces of {path.name} make no whole file: one is damaged, or the "
                "last ones are missing; copy all of them again"
            )
        with new_file(path) as part:
            _convert(joined, part, torch.float32)


def _convert(source: Path, target: Path, kind: torch.dtype) -> None:
    checkpoint = torch.load(source, map_location="cpu", weights_only=True)
    weights = checkpoint["state_dict"]
    convolutions = {name: value.to(kind) for name, value in weights.items() if value.ndim == 4}
    torch.save(checkpoint | {"state_dict": weights | convolutions}, target)
