"""The files that a module's results depend on."""

import ast
from pathlib import Path

import pytest

import shaftpose
from shaftpose import source_code
from shaftpose.source_code import imported_names, source_files

ROOT = Path(shaftpose.__file__).parent


def names(*modules: str) -> set[str]:
    return {path.relative_to(ROOT).as_posix() for path in source_files(modules)}


def test_imports_are_followed_to_the_end() -> None:
    assert names("shaftpose.core.shards") == {
        "core/shards.py", "core/geometry.py", "core/images.py", "core/instruments.py",
        "core/masks.py", "core/shard_index.py", "core/shard_schema.py",
    }  # fmt: skip


def test_what_carries_values_and_errors_is_left_out() -> None:
    """`core/images.py` imports `shaftpose.core.errors` and `shaftpose.core.files`."""
    assert not names("shaftpose.core.errors", "shaftpose.settings.schema", "shaftpose.core.files")


def test_imports_inside_functions_count() -> None:
    assert "rendering/generator.py" in names("shaftpose.farm.blender_process")


def test_several_modules_are_united_in_order() -> None:
    both = source_files(["shaftpose.network.ssd.heads", "shaftpose.network.ssd.default_boxes"])
    assert both == sorted(both)
    assert names("shaftpose.network.ssd.heads", "shaftpose.network.ssd.default_boxes") == names(
        "shaftpose.network.ssd.heads"
    ) | names("shaftpose.network.ssd.default_boxes")


def test_modules_may_be_left_out() -> None:
    found = source_files(["shaftpose.core.shards"], without=["shaftpose.core.shard_schema"])
    left_out = set(source_files(["shaftpose.core.shards"])) - set(found)
    assert {path.name for path in left_out} == {"shard_schema.py"}  # others import its imports


@pytest.mark.parametrize("module", ["numpy", "pipelines.train", "shaftpose.no_such_module"])
def test_what_is_not_of_the_package_is_left_out(module: str) -> None:
    assert source_files([module]) == []


def test_the_names_of_all_forms_of_import() -> None:
    tree = ast.parse("import a.b as c\nfrom d import e\ndef f():\n    from g.h import i\n")
    assert set(imported_names(tree)) == {"a.b", "d", "d.e", "g.h", "g.h.i"}


@pytest.mark.parametrize(
    ("line", "names"),
    [
        ("from .c import d", {"a.b.c", "a.b.c.d"}),
        ("from . import c", {"a.b", "a.b.c"}),
        ("from ..c import d", {"a.c", "a.c.d"}),
        ("from .. import c", {"a", "a.c"}),
    ],
)
def test_relative_imports_begin_with_the_folder(line: str, names: set[str]) -> None:
    assert set(imported_names(ast.parse(line), "a.b")) == names


def test_a_folders_own_module_counts() -> None:
    assert "tracking/__init__.py" in names("shaftpose.tracking")


def test_relative_imports_and_folders_are_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = {
        "mine/__init__.py": "from .layers import Layer",
        "mine/layers.py": "from ..other import Base",
        "other.py": "",
        "unused.py": "",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(source_code, "__file__", str(tmp_path / "source_code.py"))
    found = [path.relative_to(tmp_path).as_posix() for path in source_files(["shaftpose.mine"])]
    assert found == ["mine/__init__.py", "mine/layers.py", "other.py"]
