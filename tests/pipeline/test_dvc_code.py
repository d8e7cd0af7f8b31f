"""dvc.yaml lists all code that a stage's results depend on: the imports of its script, followed."""

import ast
import re
from collections.abc import Collection
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.pipeline.conftest import ROOT
from tests.test_architecture import imports

STAGES: dict[str, Any] = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
# dvc.yaml says why they are left out.
PLUMBING = frozenset(
    {
        "pipelines/results.py",
        "pipelines/settings.py",
        "pipelines/stage.py",
        "src/shaftpose/config.py",
        "src/shaftpose/errors.py",
        "src/shaftpose/files.py",
        "src/shaftpose/nested.py",
        "src/shaftpose/network/scaling.py",
        "src/shaftpose/sweep.py",
        "src/shaftpose/tracking.py",
    }
)
# Where Hydra finds classes to build: callbacks for whoever uses it, networks where asked to.
CONFIGURED = {
    "hydra": ("config.yaml",),
    "hydra.utils.instantiate": ("backbone/*.yaml", "variant/*.yaml"),
}
CODE = ("pipelines/", "src/")
STAGE_AND_DEP = [
    (stage, dep) for stage in STAGES for dep in STAGES[stage]["deps"] if dep.startswith(CODE)
]


def script(command: str) -> str:
    """The script that a stage's command runs, as a path from the root."""
    found = re.search(r"pipelines/\w+\.py", command)
    assert found, f"{command!r} runs no script of pipelines/"
    return found.group()


def reached(name: str) -> set[str]:
    """The files that run when this one does, itself and what it names included."""
    found, new = set[str](), {name}
    while new:
        found |= new
        new = {named for path in new for named in directly_named(path)} - found
    return found


@cache
def directly_named(name: str) -> frozenset[str]:
    """The project's files that one file imports, runs or reads by a name that it spells out."""
    path = ROOT / name
    if path.suffix != ".py":
        return frozenset()
    modules, texts = imports(path), strings(path)
    # A worker process is started by its module's name, in a string.
    by_name = {text for text in texts if text.startswith("shaftpose.")}
    modules |= by_name | built_by_hydra(modules)
    found = {module_file(name) for module in modules for name in with_parents(module)}
    beside = {path.parent / text for text in texts if re.fullmatch(r"[\w.]+\.\w+", text)}
    found |= {relative(file) for file in beside if file.is_file()}
    return frozenset(found - {None})


def strings(path: Path) -> set[str]:
    nodes = ast.walk(ast.parse(path.read_text()))
    return {n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)}


def built_by_hydra(modules: Collection[str]) -> set[str]:
    """The modules of classes that conf/ names for Hydra to build where `modules` are imported."""
    patterns = [pattern for module in modules for pattern in CONFIGURED.get(module, ())]
    files = [path for pattern in patterns for path in (ROOT / "conf").glob(pattern)]
    return {
        name for file in files for name in re.findall(r"_target_: ([\w.]+)\.\w+", file.read_text())
    }


def with_parents(module: str) -> list[str]:
    """a.b.c -> a, a.b, a.b.c: Python runs the `__init__` of each."""
    return list(accumulate(module.split("."), lambda parent, name: f"{parent}.{name}"))


def module_file(module: str) -> str | None:
    """The project's file of a module; None for others' and for `__init__` without a statement."""
    for folder in (ROOT / "pipelines", ROOT / "src"):
        path = folder.joinpath(*module.split("."))
        if path.with_suffix(".py").is_file():
            return relative(path.with_suffix(".py"))
        if (path / "__init__.py").is_file() and does_something(path / "__init__.py"):
            return relative(path / "__init__.py")
    return None


def does_something(init: Path) -> bool:
    tree = ast.parse(init.read_text())
    return len(tree.body) > (ast.get_docstring(tree) is not None)


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def unlisted(command: str, deps: Collection[str]) -> set[str]:
    """The files that a stage reaches and `deps` do not cover."""
    return {
        file
        for file in reached(script(command)) - PLUMBING
        if not any(f"{file}/".startswith(f"{dep}/") for dep in deps)
    }


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_lists_the_code_that_it_reaches(stage: str) -> None:
    assert unlisted(STAGES[stage]["cmd"], STAGES[stage]["deps"]) == set()


@pytest.mark.parametrize(("stage", "dep"), STAGE_AND_DEP)
def test_a_stage_lists_no_code_twice_or_in_vain(stage: str, dep: str) -> None:
    """Of a stage's list nothing can be removed unnoticed."""
    others = [other for other in STAGES[stage]["deps"] if other != dep]
    assert unlisted(STAGES[stage]["cmd"], others) != set()


def test_plumbing_is_reached_and_known_to_the_reader_of_dvc_yaml() -> None:
    everywhere = set().union(*(reached(script(stage["cmd"])) for stage in STAGES.values()))
    assert everywhere >= PLUMBING
    comment = (ROOT / "dvc.yaml").read_text().partition("stages:")[0]
    assert set(re.findall(r"[\w/]+\.py", comment)) >= PLUMBING


def test_files_are_followed_however_they_are_named() -> None:
    render, report, train = (reached(f"pipelines/{s}.py") for s in ("render", "report", "train"))
    assert "src/shaftpose/rendering/worker.py" in directly_named(
        "src/shaftpose/rendering/shard_task.py"
    )
    assert "src/shaftpose/rendering/generator.py" in render  # imported inside a function
    assert "src/shaftpose/evaluation/report.html.j2" in report
    assert "src/shaftpose/network/heads.py" in directly_named("pipelines/networks.py")
    assert "src/shaftpose/rendering/blender.py" not in train
