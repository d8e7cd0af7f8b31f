"""The import rules of the project, read from the source."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from shaftpose.source_code import imported_names

ROOT = Path(__file__).parents[1]
PACKAGE, PIPELINES = ROOT / "src/shaftpose", ROOT / "pipelines"
# Folder -> the folders it may import from; all may import from `EVERYWHERE`.
FOLDERS = {
    "core": (),
    "settings": (),
    "image_files": (),
    "backgrounds": ("image_files",),
    "rendering": ("backgrounds",),
    "dataset": ("image_files",),
    "farm": ("rendering",),
    "metrics": (),
    "figures": ("metrics",),
    "checks": ("rendering", "figures"),
    "refinement": (),
    "network": ("dataset", "refinement"),
    "training": ("dataset", "network", "metrics"),
    "tracking": (),
    "sweeps": ("metrics", "figures", "tracking"),
    "frame_sources": ("image_files",),
    "inference": ("frame_sources", "image_files", "metrics", "refinement", "figures", "tracking"),
    "evaluation": ("dataset", "metrics", "figures", "refinement", "inference"),
    "export": ("dataset", "network", "metrics", "refinement", "inference"),
    "report": ("dataset", "metrics", "figures", "evaluation"),
    "cli": ("image_files", "frame_sources", "inference", "dataset", "farm", "figures"),
}
EVERYWHERE = ("core", "settings")
# Top-level files. Within the package, those in `GROUND` import only each other.
GROUND = {"__init__", "huge_pages", "stage_files", "origin", "source_code"}
# Tool -> path prefixes of the files that may import it.
OWNERS = {
    "bpy": ("src/shaftpose/rendering/",),
    "distributed": ("src/shaftpose/farm/",),
    "dask_jobqueue": ("src/shaftpose/farm/cluster.py",),
    "mlflow": ("src/shaftpose/tracking/",),
    "hydra": ("src/shaftpose/settings/", "src/shaftpose/sweeps/callback.py"),
    "torch": tuple(
        f"src/shaftpose/{folder}/" for folder in ("dataset", "network", "training", "export")
    ),
    "onnxruntime": (
        "src/shaftpose/inference/",
        "src/shaftpose/export/",
        "src/shaftpose/tracking/models.py",
    ),
    "rerun": ("src/shaftpose/inference/rerun_file.py",),
    "trimesh": ("src/shaftpose/rendering/cad.py",),
}
LONGEST_STAGE = 40  # lines


def source_files(*folders: Path) -> list[Path]:
    return sorted(path for folder in folders for path in folder.rglob("*.py"))


def imports(path: Path) -> set[str]:
    return set(imported_names(ast.parse(path.read_text())))


def within(modules: set[str], *parents: str) -> set[str]:
    """The modules that equal one of `parents` or lie inside it."""
    return {module for module in modules if any(f"{module}.".startswith(f"{p}.") for p in parents)}


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_every_file_of_the_package_has_its_place() -> None:
    folders = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    assert folders == FOLDERS.keys()
    assert {path.stem for path in PACKAGE.glob("*.py")} == GROUND


@pytest.mark.parametrize("folder", FOLDERS)
def test_folders_import_in_one_direction(folder: str) -> None:
    allowed = {folder, *FOLDERS[folder], *EVERYWHERE}
    forbidden = [f"shaftpose.{name}" for name in FOLDERS.keys() - allowed]
    found = {relative(p): within(imports(p), *forbidden) for p in source_files(PACKAGE / folder)}
    assert {path: modules for path, modules in found.items() if modules} == {}


def test_the_declared_order_has_no_circle() -> None:
    seen = set[str]()
    for folder, below in FOLDERS.items():
        assert set(below) <= seen, f"{folder} is declared before a folder it imports from"
        seen.add(folder)
    assert not within(imports_of("core"), "shaftpose.settings")


def imports_of(folder: str) -> set[str]:
    return set().union(*(imports(path) for path in source_files(PACKAGE / folder)))


def test_the_ground_stands_on_nothing_else() -> None:
    above = [f"shaftpose.{name}" for name in FOLDERS.keys() - {"core"}]
    assert not {n: w for n in GROUND if (w := within(imports(PACKAGE / f"{n}.py"), *above))}


@pytest.mark.parametrize("tool", OWNERS)
def test_a_tool_is_known_to_its_owner_alone(tool: str) -> None:
    users = {relative(p) for p in source_files(PACKAGE, PIPELINES) if within(imports(p), tool)}
    assert users, f"no file imports {tool}: this test checks nothing"
    assert {user for user in users if not user.startswith(OWNERS[tool])} == set()


@pytest.mark.parametrize("script", sorted(path.name for path in PIPELINES.glob("*.py")))
def test_a_stage_is_short_and_imports_no_other(script: str) -> None:
    path = PIPELINES / script
    assert len(path.read_text().splitlines()) <= LONGEST_STAGE
    others = {other.stem for other in PIPELINES.glob("*.py")}
    assert not within(imports(path), "pipelines", *others)


def test_paths_are_not_edited_and_imports_stand_first() -> None:
    folders = [ROOT / name for name in ("src", "pipelines", "studies", "benchmarks", "tests")]
    wrong = re.compile(r"sys\.path(\.insert|\[|\.append)|noqa: E" + "402")
    found = [relative(p) for p in source_files(*folders) if wrong.search(p.read_text())]
    assert found == []


def test_nobody_in_the_package_imports_pipelines_or_studies() -> None:
    found = {relative(p): within(imports(p), "pipelines", "studies") for p in source_files(PACKAGE)}
    assert {path: modules for path, modules in found.items() if modules} == {}


@pytest.mark.parametrize(
    ("module", "missing"),
    [
        ("training.bare", ("bpy", "dvc", "mlflow", "hydra", "omegaconf", "onnx")),
        ("dataset.training_data", ("bpy", "dvc", "mlflow")),
        ("inference.predictor", ("torch", "lightning", "bpy", "dvc", "mlflow", "hydra")),
        ("cli.predict", ("torch", "lightning", "bpy", "dvc", "mlflow", "hydra", "pydantic")),
        ("cli.main", ("numpy", "cv2", "onnxruntime", "tqdm")),  # for its command `check`
    ],
)
def test_modules_load_where_a_tool_is_missing(module: str, missing: tuple[str, ...]) -> None:
    statement = f"import sys; sys.modules.update(dict.fromkeys({missing})); "
    done = subprocess.run(
        [sys.executable, "-c", f"{statement}import shaftpose.{module}"],
        capture_output=True, text=True,
    )  # fmt: skip
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
