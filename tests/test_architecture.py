"""The import rules of the house, read from the source."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE, PIPELINES = ROOT / "src" / "shaftpose", ROOT / "pipelines"
STEPS = ("backgrounds", "rendering", "dataset", "network", "evaluation", "deployment")
GROUND_FLOOR = (
    "geometry",
    "shards",
    "config",
    "errors",
    "files",
    "instruments",
    "images",
    "batches",
    "nested",
)
# The places that may know a tool, as paths from the root that a file's path starts with.
OWNERS = {
    "bpy": ("src/shaftpose/rendering/",),
    "distributed": ("src/shaftpose/rendering/",),
    "dask_jobqueue": ("src/shaftpose/rendering/cluster.py",),
    "mlflow": ("src/shaftpose/tracking.py",),
    "hydra": ("pipelines/", "src/shaftpose/sweep.py"),
    "trimesh": ("src/shaftpose/rendering/cad.py",),
}


def source_files(*folders: Path) -> list[Path]:
    return sorted(path for folder in folders for path in folder.rglob("*.py"))


def imports(path: Path) -> set[str]:
    """The modules that a file imports, wherever in it; of `from a import b` both a and a.b."""
    return set(_imports(ast.parse(path.read_text())))


def _imports(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute: these tests cannot follow others"
            yield str(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def within(modules: set[str], *parents: str) -> set[str]:
    """Those modules that are one of `parents` or lie inside one."""
    return {module for module in modules if any(f"{module}.".startswith(f"{p}.") for p in parents)}


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def steps_but(own: str = "") -> list[str]:
    return [f"shaftpose.{step}" for step in STEPS if step != own]


@pytest.mark.parametrize("tool", OWNERS)
def test_a_tool_is_known_to_its_owner_alone(tool: str) -> None:
    users = {relative(p) for p in source_files(PACKAGE, PIPELINES) if within(imports(p), tool)}
    assert users, f"nobody imports {tool}: this test watches nothing"
    assert {user for user in users if not user.startswith(OWNERS[tool])} == set()


@pytest.mark.parametrize("step", STEPS)
def test_steps_do_not_import_each_other(step: str) -> None:
    files = source_files(PACKAGE / step)
    assert files
    found = {relative(path): within(imports(path), *steps_but(step)) for path in files}
    assert {path: modules for path, modules in found.items() if modules} == {}


@pytest.mark.parametrize("step", ["network", "dataset"])
def test_training_needs_neither_blender_nor_dvc_nor_mlflow(step: str) -> None:
    forbidden = ("bpy", "dvc", "mlflow", "shaftpose.tracking", "shaftpose.cli")
    found = {relative(p): within(imports(p), *forbidden) for p in source_files(PACKAGE / step)}
    assert {path: modules for path, modules in found.items() if modules} == {}


@pytest.mark.parametrize("name", GROUND_FLOOR)
def test_the_ground_floor_rests_on_nothing_above(name: str) -> None:
    above = (*steps_but(), "shaftpose.tracking", "shaftpose.cli", "shaftpose.sweep")
    assert within(imports(PACKAGE / f"{name}.py"), *above) == set()


def test_every_file_of_the_package_has_its_place() -> None:
    folders = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    assert folders == set(STEPS)
    files = {path.stem for path in PACKAGE.glob("*.py")}
    assert files <= {"__init__", "tracking", "cli", "sweep", *GROUND_FLOOR}


def test_nobody_below_imports_the_pipelines() -> None:
    stages = {path.stem for path in PIPELINES.glob("*.py")}
    found = {relative(path): within(imports(path), *stages) for path in source_files(PACKAGE)}
    assert {path: modules for path, modules in found.items() if modules} == {}


def test_training_runs_where_blender_dvc_and_mlflow_are_missing() -> None:
    statement = (
        "import sys; sys.modules.update(dict.fromkeys(('bpy', 'dvc', 'mlflow')));"
        "import shaftpose.network.module, shaftpose.dataset.training_data"
    )
    done = subprocess.run([sys.executable, "-c", statement], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_reader_of_imports_finds_them_all(tmp_path: Path) -> None:
    file = tmp_path / "file.py"
    file.write_text(
        "import os.path as p\nfrom shaftpose import tracking\n"
        "def f():\n    import bpy\n    from mlflow.data import x\n"
    )
    assert imports(file) == {
        "os.path", "shaftpose", "shaftpose.tracking", "bpy", "mlflow.data", "mlflow.data.x"
    }  # fmt: skip
    assert within(imports(file), "mlflow", "os", "track") == {
        "os.path", "mlflow.data", "mlflow.data.x"
    }  # fmt: skip
