"""The files of the package whose change trains a variant again."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pytest

import shaftpose
from shaftpose.stage_files import DataRecord
from shaftpose.training.fingerprint import READERS, VALIDATION, code_files, fingerprint
from tests.pipeline.conftest import recipe_with

PACKAGE = Path(shaftpose.__file__).parent
PAPERS, ALL = {"b", "c", "d"}, {"b", "c", "d", "e"}
# File or folder -> the variants that it trains again. The longest name that fits a file counts.
RULES: dict[str, set[str]] = {
    "": set(),
    "core/geometry.py": ALL,
    "core/images.py": ALL,
    "core/instruments.py": ALL,
    "core/masks.py": ALL,
    "core/shard_index.py": ALL,
    "core/shard_schema.py": ALL,
    "core/shards.py": ALL,
    "core/symmetries.py": ALL,
    "dataset": ALL,
    "dataset/coco.py": set(),
    "dataset/coco_folder.py": set(),
    "dataset/segmentation.py": set(),
    "network": ALL,
    "network/ssd": PAPERS,
    "network/ssd/decoding.py": set(),
    "network/ssd/pose_bins.py": {"b"},
    "network/dense": {"e"},
    "network/dense/decoding.py": set(),
    "refinement/contour.py": {"e"},
    "refinement/contour_sampling.py": {"e"},
    "refinement/pose_parameters.py": {"e"},
    "training": ALL,
    "training/bare.py": set(),
    "training/fingerprint.py": set(),
    "training/pieces.py": set(),
    "training/validation_metrics.py": set(),
}
FILES = sorted(
    path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if path.name != "__init__.py"
)
DATA = DataRecord(start=None, training_images=8, digest="of images", mixed_in=None)


def rule(file: Path) -> set[str]:
    """The variants that a file trains again."""
    names = [file.as_posix(), *(folder.as_posix() for folder in file.parents)]
    return next(RULES[name] for name in (*names, "") if name in RULES)


@pytest.mark.parametrize("variant", sorted(ALL))
def test_a_variant_depends_on_these_files_and_no_others(variant: str) -> None:
    found = {path.relative_to(PACKAGE) for path in code_files(recipe_with(f"variant={variant}"))}
    assert found == {file for file in FILES if variant in rule(file)}


def test_rules_and_exceptions_name_what_exists() -> None:
    assert [name for name in RULES if not (PACKAGE / name).exists()] == []
    assert all(map(find_spec, (*READERS, *VALIDATION)))


@pytest.mark.parametrize(
    ("place", "trained_again"),
    [
        ("metrics", set()),
        ("figures", set()),
        ("dataset/coco.py", set()),
        ("network/ssd", {"d"}),
        ("network/dense", {"e"}),
        ("network/pose_network.py", {"d", "e"}),
    ],
)
def test_changed_bytes_train_again_what_depends_on_them(
    monkeypatch: pytest.MonkeyPatch, place: str, trained_again: set[str]
) -> None:
    recipes = {name: recipe_with(f"variant={name}") for name in ("d", "e")}
    before = {name: fingerprint(recipe, DATA) for name, recipe in recipes.items()}
    read, changed = Path.read_bytes, PACKAGE / place
    assert changed.exists()

    def changed_bytes(path: Path) -> bytes:
        return read(path) + b" " * path.is_relative_to(changed)

    monkeypatch.setattr(Path, "read_bytes", changed_bytes)
    after = {name: fingerprint(recipe, DATA) for name, recipe in recipes.items()}
    assert {name for name in recipes if after[name] != before[name]} == trained_again


@pytest.mark.parametrize("option", ["keep_best=true", "patience=2"])
def test_what_validation_computes_counts_where_it_decides(option: str) -> None:
    plain, decided = recipe_with("variant=e"), recipe_with("variant=e", f"training.{option}")
    added = {path.relative_to(PACKAGE).as_posix() for path in code_files(decided)}
    added -= {path.relative_to(PACKAGE).as_posix() for path in code_files(plain)}
    assert {"training/validation_metrics.py", "network/dense/decoding.py"} <= added
    assert any(name.startswith("metrics/") for name in added)
    fewer = replace(decided.detection, max_detections=3)
    assert fingerprint(replace(decided, detection=fewer), DATA) != fingerprint(decided, DATA)
    assert fingerprint(replace(plain, detection=fewer), DATA) == fingerprint(plain, DATA)
    unread = replace(decided.detection, confidence_threshold=0.9, refine="none")
    assert fingerprint(replace(decided, detection=unread), DATA) == fingerprint(decided, DATA)
