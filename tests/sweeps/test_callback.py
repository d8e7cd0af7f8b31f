"""The settings that a sweep varies."""

from shaftpose.sweeps.callback import swept


def test_only_keys_with_several_values_are_swept() -> None:
    given = ["variant=d", "loss.alpha=0.5,1.5", "loss.beta=[1,1],[2,2]", "+seed=range(1,4)"]
    assert swept(given) == {
        "loss.alpha": "0.5,1.5", "loss.beta": "[1,1],[2,2]", "seed": "range(1,4)",
    }  # fmt: skip
