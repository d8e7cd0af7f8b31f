"""Each way of installing the package provides the packages that its users import."""

import ast
import json
import re
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import cv2
import pytest

from tests.pipeline.conftest import copy_tracked

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src"
FRAMES = ROOT / "tests/data/bundled_models/shaftpose"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

HEAVY = [
    "bpy", "dask", "distributed", "dvc", "filelock", "hydra", "jinja2", "lightning", "matplotlib",
    "mlflow", "omegaconf", "onnx", "onnxscript", "openvino", "psutil", "pydantic", "rerun", "torch",
    "trimesh", "yaml",
]  # fmt: skip
NOT_PACKED = (".github/", ".dvc/", "data/.gitkeep")  # of use in a Git repository only
# Import name -> distribution, where the names differ or the distribution pins the imported one.
PACKAGES = {
    "cv2": "opencv-python-headless", "dask": "distributed", "hydra": "hydra-core",
    "markdown_it": "markdown-it-py", "omegaconf": "hydra-core", "rerun": "rerun-sdk",
    "yaml": "pyyaml",
}  # fmt: skip
# Extras -> parts of the package that need only these.
PARTS = {
    "render": ["backgrounds", "rendering"],
    "train": ["dataset", "network", "training"],
    "pipeline,openvino,rerun": [""],
}

# Runs the command line without some packages, then prints the names of the modules it loaded from
# files.
RUN = """
import json, sys
blocked, arguments = json.loads(sys.argv[1])
sys.modules.update(dict.fromkeys(blocked))
before = set(sys.modules)
from shaftpose.cli.main import main
main(arguments)
new = [name for name, m in sys.modules.items() if name not in before and hasattr(m, "__file__")]
print(json.dumps(new))
"""


def run_without(blocked: list[str], *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", RUN, json.dumps([blocked, arguments])]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def predict_frames(blocked: list[str], out: Path) -> tuple[list[str], list[str]]:
    """The lines that predicting the bundled frames printed, and the modules that it loaded."""
    frames = sorted(map(str, FRAMES.glob("*.jpg")))
    result = run_without(blocked, "predict", *frames, "--out", str(out), "--draw")
    assert result.returncode == 0, result.stderr
    *_, loaded = result.stdout.splitlines()
    return (out / "predictions.jsonl").read_text().splitlines(), json.loads(loaded)


def packages(modules: Iterable[str]) -> set[str]:
    """Distributions that the modules need, without this package and Python."""
    names = {module.partition(".")[0] for module in modules} - sys.stdlib_module_names
    return {PACKAGES.get(name, canonical(name)) for name in names - {"shaftpose"}}


def canonical(name: str) -> str:
    """A package's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def required(requirements: Iterable[str]) -> set[str]:
    """Packages listed in requirements, including those of this package's extras."""
    found = set()
    for text in requirements:
        match = re.match(r"([\w.-]+)(?:\[([\w,]+)\])?", text)
        assert match is not None
        if match[1] == "shaftpose":
            for extra in match[2].split(","):
                found |= required(PROJECT["optional-dependencies"][extra])
        else:
            found.add(canonical(match[1]))
    return found


def test_prediction_runs_without_what_the_extras_bring(tmp_path: Path) -> None:
    lines, _ = predict_frames(HEAVY, tmp_path / "found")
    found = [json.loads(line)["instruments"] for line in lines]
    assert len(found) == len(list(FRAMES.glob("*.jpg"))) > 0
    assert all({"score", "box", "x_mm", "yaw_deg"} <= one.keys() for each in found for one in each)
    assert sum(map(len, found)) >= json.loads((FRAMES / "frames.json").read_text())["found"]
    for frame in FRAMES.glob("*.jpg"):
        assert cv2.imread(str(tmp_path / "found" / frame.name)).shape == (299, 299, 3)


def test_prediction_imports_what_a_plain_installation_brings(tmp_path: Path) -> None:
    _, loaded = predict_frames([], tmp_path / "found")
    assert packages(loaded) == required(PROJECT["dependencies"])


@pytest.mark.parametrize("extra", PARTS)
def test_an_extra_brings_what_its_modules_import(extra: str) -> None:
    brought = required([*PROJECT["dependencies"], f"shaftpose[{extra}]"])
    imported = packages(
        name for part in PARTS[extra] for file in files_of(part) for name in reached(file)
    )
    assert len(imported) > 5
    assert imported <= brought


def test_developers_install_all_extras() -> None:
    extras = PROJECT["optional-dependencies"]
    assert required(["shaftpose[dev]"]) == set().union(*map(required, extras.values()))


def test_show_names_the_extra_that_it_lacks(tmp_path: Path) -> None:
    (tmp_path / "train.json").write_text("{}")
    out = str(tmp_path / "sheet.jpg")
    result = run_without(HEAVY, "show", "dataset", str(tmp_path), "--out", out)
    assert result.returncode == 1
    assert re.fullmatch(
        r"error: .*not installed; in a clone, run pip install '\.\[train\]'\n", result.stderr
    )


def test_workers_need_the_extra_cluster_alone(tmp_path: Path) -> None:
    arguments = ("predict", str(FRAMES), "--workers", "1", "--out", str(tmp_path / "found"))
    result = run_without(HEAVY, *arguments)
    assert result.returncode == 1
    assert result.stderr == "error: --workers: needs Dask: in a clone, pip install '.[cluster]'\n"
    dask = {"dask", "distributed", "jinja2", "psutil", "yaml"}  # and what it needs itself
    result = run_without([name for name in HEAVY if name not in dask], *arguments)
    assert result.returncode == 0, result.stderr
    assert len((tmp_path / "found/predictions.jsonl").read_text().splitlines()) == 3
    assert required(["shaftpose[cluster]"]) <= required(["shaftpose[render]"])


def test_recordings_need_the_extra_rerun(tmp_path: Path) -> None:
    arguments = ("predict", str(FRAMES), "--rerun", "--out", str(tmp_path / "found"))
    result = run_without(HEAVY, *arguments)
    assert result.returncode == 1
    assert "error: --rerun: needs Rerun: in a clone, pip install '.[rerun]'\n" in result.stderr


def test_the_backend_openvino_needs_its_extra(tmp_path: Path) -> None:
    arguments = ("predict", str(FRAMES), "--backend", "openvino", "--out", str(tmp_path / "found"))
    result = run_without(HEAVY, *arguments)
    assert result.returncode == 1
    message = "error: --backend openvino: needs OpenVINO: in a clone, pip install '.[openvino]' ("
    assert message in result.stderr


def test_wheels_say_that_the_package_is_typed() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "py.typed" in settings["tool"]["setuptools"]["package-data"]["shaftpose"]
    assert (SOURCE / "shaftpose/py.typed").is_file()


def files_of(part: str) -> list[Path]:
    """The files of a module or folder of the package."""
    path = SOURCE.joinpath("shaftpose", *filter(None, part.split(".")))
    return sorted(path.rglob("*.py")) if path.is_dir() else [path.with_suffix(".py")]


@cache
def reached(file: Path) -> frozenset[str]:
    """Names imported by a file and, recursively, by the package's modules it imports."""
    new, seen, found = {file}, set(), set()
    while new:
        seen |= new
        names = {name for one in new for name in imports(one)}
        found |= names
        new = {path for name in names if (path := module_file(name)) is not None} - seen
    return frozenset(found)


@cache
def imports(file: Path) -> frozenset[str]:
    return frozenset(named(ast.parse(file.read_text())))


def named(node: ast.AST) -> Iterator[str]:
    """Names imported at run time; imports for type checkers only are skipped."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
            yield str(child.module)
        elif not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield from named(child)


def module_file(name: str) -> Path | None:
    path = SOURCE.joinpath(*name.split(".")).with_suffix(".py")
    return path if path.is_file() else None


def test_the_source_distribution_is_complete(tmp_path: Path) -> None:
    clone, out = tmp_path / "clone", tmp_path / "out"
    copy_tracked(ROOT, clone)
    (clone / "src/shaftpose/rendering/__pycache__").mkdir()
    (clone / "src/shaftpose/rendering/__pycache__/scene.pyc").touch()
    build = f"from setuptools.build_meta import build_sdist; build_sdist({str(out)!r})"
    subprocess.run([sys.executable, "-c", build], cwd=clone, check=True, capture_output=True)
    with tarfile.open(next(out.glob("*.tar.gz"))) as archive:
        packed = {name.partition("/")[2] for name in archive.getnames()}
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    tracked = {name for name in listed.stdout.splitlines() if (ROOT / name).is_file()}
    assert {name for name in tracked - packed if not name.startswith(NOT_PACKED)} == set()
    assert not [name for name in packed if name.endswith(".pyc")]


def test_an_index_gets_a_description_without_links_into_the_clone() -> None:
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / PROJECT["readme"]).read_text())
    assert all(link.startswith("https://") for link in links)
    assert {"authors", "classifiers", "urls"} <= PROJECT.keys()
