"""dvc.yaml lists the parameters and the data that each stage reads, told from its script's text."""

import ast
from collections.abc import Collection, Iterable, Iterator
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from shaftpose.config import (
    BackgroundSettings,
    DetectionSettings,
    Size,
    TrainingSettings,
    Variant,
)
from tests.pipeline.conftest import ROOT
from tests.pipeline.test_dvc_code import CODE, STAGES, script

# Parts of the configuration that a stage has checked as a whole, to read some of their values:
# those whose names occur as attributes in its script, for it does not hand these objects on.
READ_IN_PART: dict[str, type] = {
    "backgrounds": BackgroundSettings,
    "detection": DetectionSettings,
    "size": Size,
    "training": TrainingSettings,
    "variant": Variant,
}
# Where a stage reads and writes, which its command and its lists say, how fast it runs, and how
# long it may: a training that was ended is not to be repeated when there is more time.
NOT_LISTED = frozenset(
    {"out", "results", "model_folder", "variant_file", "profile", "tracking"}
    | {"cluster", "training.loader_workers", "training.checkpoint_minutes", "training.max_hours"}
)
BUT_LISTED = {"report": {"profile"}}  # names it; to others it is a way to find sizes
WITHOUT_EFFECT = {
    # A line of the log; the steps of a stage of its own.
    "train": {"variant.title", "size.detector_steps"},
    # Camera, lens and shaft make a silhouette; the rest of the render settings is checked.
    "evaluate_real": {"poses", "scene", "render.jpeg_quality", "render.device", "size.samples"},
    "validate": {"render.device"},  # images are valid whatever has rendered them
}
# A file that a stage reads because a file of conf/ names it: a variant's `start`.
STARTED_FROM = "models/detector/model.ckpt"
# The same script as `train`; what differs is in a test of its own.
BY_SCRIPT = [stage for stage in STAGES if stage != "detector"]
# Not read for results: MLflow and training.json show most of the configuration of a training, and
# the name of its scratch folder depends on it.
TRACKED = {"logged_parameters", "fingerprint", "recipe", "settings_of"}
# What an interrupted render or training left, named after all that determines it.
SCRATCH = "data/scratch"

Definition = tuple[str, ast.stmt]


@cache
def definitions(module: str) -> dict[str, Definition]:
    """Name -> (script, node) of each function, class and constant that a script has or imports
    from another one."""
    found: dict[str, Definition] = {}
    for node in ast.parse((ROOT / f"pipelines/{module}.py").read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node.name] = module, node
        elif isinstance(node, ast.Assign):
            found |= {t.id: (module, node) for t in node.targets if isinstance(t, ast.Name)}
        elif isinstance(node, ast.ImportFrom) and is_script(f"{node.module}"):
            others = definitions(f"{node.module}")
            found |= {alias.name: others[alias.name] for alias in node.names}
    return found


def is_script(module: str) -> bool:
    return (ROOT / f"pipelines/{module}.py").is_file()


@cache
def used_by(stage: str) -> list[list[ast.AST]]:
    """What `main` of a stage's script uses of pipelines/, itself included: the nodes of each."""
    main = definitions(Path(script(STAGES[stage]["cmd"])).stem)["main"]
    found, new = [main], [main]
    while new:
        module, node = new.pop()
        names = {n.id for n in inside(node) if isinstance(n, ast.Name)} - TRACKED
        more = [d for name, d in definitions(module).items() if name in names and d not in found]
        found, new = found + more, new + more
    return [inside(node) for _, node in found]


def inside(definition: ast.stmt) -> list[ast.AST]:
    """All nodes of a definition but for its decorators: `stage` checks all of the configuration."""
    parts = definition.body if isinstance(definition, ast.FunctionDef) else [definition]
    return [node for part in parts for node in ast.walk(part)]


def parameters_read(stage: str) -> set[str]:
    """Dotted keys of the composed configuration; a profile's are `size.KEY`."""
    keys = {key for nodes in used_by(stage) for key in config_keys(nodes)}
    attributes = {n.attr for nodes in used_by(stage) for n in nodes if isinstance(n, ast.Attribute)}
    for part in keys & READ_IN_PART.keys():
        names = {field.name for field in fields(READ_IN_PART[part])}
        keys = keys - {part} | {f"{part}.{name}" for name in names & attributes}
    if keys & {"backbone", "trainer"}:
        keys.add("defaults")  # of conf/config.yaml, which choose them
    return keys


def config_keys(nodes: list[ast.AST]) -> set[str]:
    """`config["a"]["b"]` -> a.b, in one function."""
    subscripts = [node for node in nodes if isinstance(node, ast.Subscript)]
    inner = [subscript.value for subscript in subscripts]
    loops = {
        node.target.id: [n.value for n in node.iter.elts if isinstance(n, ast.Constant)]
        for node in nodes
        if isinstance(node, ast.comprehension)
        and isinstance(node.target, ast.Name)
        and isinstance(node.iter, ast.Tuple)
    }
    return {key for node in subscripts if node not in inner for key in dotted(node, loops)}


def dotted(node: ast.expr, loops: dict[str, list[str]]) -> list[str]:
    """The keys that a chain of subscripts of `config` stands for: several in a loop over names."""
    if not isinstance(node, ast.Subscript):
        return [""] if isinstance(node, ast.Name) and node.id == "config" else []
    parents = dotted(node.value, loops)
    if not parents:
        return []
    index = node.slice
    names = loops[index.id] if isinstance(index, ast.Name) else [ast.literal_eval(index)]
    return [f"{parent}.{name}".lstrip(".") for parent in parents for name in names]


def parameters_listed(stage: str) -> Iterator[str]:
    """The parameters of a stage in dvc.yaml, by the same keys."""
    for entry in STAGES[stage].get("params", ()):
        for file, keys in ({"params.yaml": [entry]} if isinstance(entry, str) else entry).items():
            yield from (config_key(file, key) for key in keys or [""])


def config_key(file: str, key: str) -> str:
    """The key in the composed configuration of one in a file of conf/; no key: the whole file."""
    if file == "conf/profiles.yaml":
        return key.replace("${profile}", "size")
    group = Path(file).parent.name
    return f"{group}.{key}".strip(".") if group not in ("", "conf") else key


def unlisted_parameters(stage: str, listed: Collection[str]) -> set[str]:
    """What a stage reads and `listed` lacks."""
    not_listed = NOT_LISTED - BUT_LISTED.get(stage, set())
    read = parameters_read(stage) - not_listed - WITHOUT_EFFECT.get(stage, set())
    return {key for key in read if not any(f"{key}.".startswith(f"{part}.") for part in listed)}


def data_read(stage: str) -> set[str]:
    """Files and folders of data/ and models/ that a stage's script names and does not write."""
    texts = {
        node.value
        for nodes in used_by(stage)
        for node in nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    known = {dep for name in STAGES for dep in data_listed(name)}
    found = {path for path in known if path.startswith("models/") and Path(path).name in texts}
    found = found - {STARTED_FROM} | ({STARTED_FROM} if stage == "train" else set())
    for folder in {text for text in texts if text.startswith("data/")} - {SCRATCH}:
        # A folder's name may be joined with others, as in Path("data/render") / name.
        found |= {f"{folder}/{text}" for text in texts} & known or {folder}
    return found - set(paths(STAGES[stage]["outs"]))


def data_listed(stage: str) -> list[str]:
    return [dep for dep in paths(STAGES[stage]["deps"]) if not dep.startswith(CODE)]


def paths(entries: Iterable[Any]) -> list[str]:
    return [path for entry in entries for path in ([entry] if isinstance(entry, str) else entry)]


def unlisted_data(stage: str, listed: Collection[str]) -> set[str]:
    """What a stage reads and `listed` does not cover."""
    read = data_read(stage)
    return {path for path in read if not any(f"{path}/".startswith(f"{dep}/") for dep in listed)}


@pytest.mark.parametrize("stage", BY_SCRIPT)
def test_a_stage_lists_the_parameters_that_it_reads(stage: str) -> None:
    assert unlisted_parameters(stage, set(parameters_listed(stage))) == set()


@pytest.mark.parametrize("stage", BY_SCRIPT)
def test_a_stage_lists_no_parameter_in_vain(stage: str) -> None:
    listed = set(parameters_listed(stage))
    assert {key for key in listed if not unlisted_parameters(stage, listed - {key})} == set()


@pytest.mark.parametrize("stage", BY_SCRIPT)
def test_a_stage_lists_the_data_that_it_reads(stage: str) -> None:
    assert unlisted_data(stage, data_listed(stage)) == set()


@pytest.mark.parametrize("stage", BY_SCRIPT)
def test_a_stage_lists_no_data_in_vain(stage: str) -> None:
    listed = set(data_listed(stage))
    assert {path for path in listed if not unlisted_data(stage, listed - {path})} == set()


def test_the_detector_lists_what_train_lists_but_for_poses_and_real_images() -> None:
    """The poses' weights do not count, nor does it start from another network."""
    lists = {stage: set(parameters_listed(stage)) for stage in ("detector", "train")}
    named = {"loss", "size.steps"}, {"loss.alpha", "size.detector_steps"}
    detector = {key.replace("detector.", "${item.variant}.") for key in lists["detector"]}
    assert detector == lists["train"] - named[0] | named[1]
    deps = {stage: set(paths(STAGES[stage]["deps"])) for stage in ("detector", "train")}
    assert deps["detector"] == deps["train"] - {"data/real", STARTED_FROM}


def test_exceptions_are_needed() -> None:
    for stage, keys in WITHOUT_EFFECT.items():
        assert keys <= parameters_read(stage)
    assert set().union(*map(parameters_read, STAGES)) >= NOT_LISTED


def test_every_profile_has_the_listed_sizes() -> None:
    listed = {key for stage in STAGES for key in parameters_listed(stage)}
    names = {key.removeprefix("size.") for key in listed if key.startswith("size.")}
    for profile, sizes in yaml.safe_load((ROOT / "conf/profiles.yaml").read_text()).items():
        assert names <= sizes.keys(), f"{profile} lacks {names - sizes.keys()}"


def test_backbone_and_trainer_are_those_that_conf_chooses() -> None:
    defaults = yaml.safe_load((ROOT / "conf/config.yaml").read_text())["defaults"]
    chosen = {
        f"conf/{group}/{entry[group]}.yaml"
        for entry in defaults
        for group in ("backbone", "trainer")
        if group in entry
    }
    listed = paths(entry for stage in STAGES.values() for entry in stage.get("params", ()))
    assert {p for p in listed if p.startswith(("conf/backbone", "conf/trainer"))} == chosen
