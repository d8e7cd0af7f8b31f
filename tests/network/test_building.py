"""Objects from their descriptions in a variant's file."""

from fractions import Fraction

import pytest

from shaftpose.network.building import built

HALF = {"_target_": "fractions.Fraction", "numerator": 1, "denominator": 2}


def test_a_description_becomes_an_object() -> None:
    assert built(HALF) == Fraction(1, 2)
    assert built(HALF | {"numerator": HALF}) == Fraction(1, 4)


def test_what_names_no_class_stays_as_it_is() -> None:
    assert built({"x_mm": [1.0, 2.0], "cad": None}) == {"x_mm": [1.0, 2.0], "cad": None}


def test_a_partial_one_waits_for_its_other_arguments() -> None:
    halves = built({"_target_": "fractions.Fraction", "_partial_": True, "denominator": 2})
    assert halves(3) == Fraction(3, 2)


@pytest.mark.parametrize(
    ("target", "error", "named"),
    [
        ("no_such_package.Thing", ImportError, "no_such_package"),
        ("fractions.Thing", AttributeError, "Thing"),
        ("not a name", ValueError, "not a name"),
    ],
)
def test_a_wrong_name_is_refused(target: str, error: type[Exception], named: str) -> None:
    with pytest.raises(error, match=named):
        built({"_target_": target})
