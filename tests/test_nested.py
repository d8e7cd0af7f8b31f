"""Flattening of nested settings, by hand."""

from shaftpose.nested import flatten


def test_mappings_are_flat_and_sequences_whole() -> None:
    nested = {"loss": {"alpha": 1.5, "beta": [1, 2]}, "seed": 7}
    assert flatten(nested) == {"loss.alpha": 1.5, "loss.beta": [1, 2], "seed": 7}
