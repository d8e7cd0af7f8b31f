"""Checkpoints in pieces, and back."""

from pathlib import Path

import pytest
import torch

from shaftpose.core.errors import InputError
from shaftpose.training import pieces
from shaftpose.training.pieces import (
    join_checkpoint_pieces,
    join_pieces,
    write_checkpoint_pieces,
    write_pieces,
)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_pieces_join_to_the_file(tmp_path: Path) -> None:
    whole, folder = tmp_path / "whole", tmp_path / "pieces"
    for content, count in ((b"0123456789", 3), (b"01234567", 2), (b"0", 1)):
        whole.write_bytes(content)
        write_pieces(whole, folder, 4)
        assert names(folder) == [f"whole.{n:03}" for n in range(count)]
        join_pieces(folder, tmp_path / "back/whole")
        assert (tmp_path / "back/whole").read_bytes() == content


@pytest.mark.parametrize("lost", ["whole.000", "whole.001"])
def test_a_missing_piece_is_noticed(tmp_path: Path, lost: str) -> None:
    whole = tmp_path / "whole"
    whole.write_bytes(b"0123456789")
    write_pieces(whole, tmp_path / "pieces", 4)
    (tmp_path / "pieces" / lost).unlink()
    with pytest.raises(InputError, match="pieces: lacks pieces of whole"):
        join_pieces(tmp_path / "pieces", whole)


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    """A convolution, a bias, and a counter."""
    generator = torch.Generator().manual_seed(0)
    weights = {
        "conv": torch.randn(64, 8, 3, 3, generator=generator),
        "bias": torch.randn(64, generator=generator),
        "count": torch.tensor(7),
    }
    torch.save({"state_dict": weights, "identity": {"variant": "d"}}, tmp_path / "model.ckpt")
    return tmp_path / "model.ckpt"


def test_a_checkpoint_stays_as_it_is(checkpoint: Path, tmp_path: Path) -> None:
    write_checkpoint_pieces(checkpoint, tmp_path / "pieces")
    join_checkpoint_pieces(tmp_path / "pieces", tmp_path / "back/model.ckpt")
    before, after = (
        torch.load(path, weights_only=True) for path in (checkpoint, tmp_path / "back/model.ckpt")
    )
    assert after["identity"] == before["identity"]
    for name, value in before["state_dict"].items():
        assert torch.equal(after["state_dict"][name], value), name


def test_a_missing_last_piece_is_noticed(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pieces, "CHECKPOINT_PIECE_BYTES", 4096)
    write_checkpoint_pieces(checkpoint, tmp_path / "pieces")
    max((tmp_path / "pieces").iterdir()).unlink()
    with pytest.raises(InputError, match="pieces of model.ckpt make no whole file"):
        join_checkpoint_pieces(tmp_path / "pieces", tmp_path / "back/model.ckpt")
    assert not (tmp_path / "back/model.ckpt").exists()


def test_convolutions_of_a_large_checkpoint_are_rounded(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pieces, "EXACT_BYTES", 1000)
    monkeypatch.setattr(pieces, "CHECKPOINT_PIECE_BYTES", 4096)
    write_checkpoint_pieces(checkpoint, tmp_path / "pieces")
    size = sum(path.stat().st_size for path in (tmp_path / "pieces").iterdir())
    assert size < 0.65 * checkpoint.stat().st_size
    join_checkpoint_pieces(tmp_path / "pieces", tmp_path / "back/model.ckpt")
    before, after = (
        torch.load(path, weights_only=True)["state_dict"]
        for path in (checkpoint, tmp_path / "back/model.ckpt")
    )
    assert {name: value.dtype for name, value in after.items()} == {
        name: value.dtype for name, value in before.items()
    }
    assert torch.equal(after["bias"], before["bias"]) and after["count"] == 7
    torch.testing.assert_close(after["conv"], before["conv"], rtol=2**-11, atol=1e-7)
    assert not torch.equal(after["conv"], before["conv"])
