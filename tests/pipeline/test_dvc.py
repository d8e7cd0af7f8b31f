"""dvc.yaml lists the dependencies of each stage's results: folders of code, settings and data."""

import ast
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from shaftpose.source_code import imported_names, source_files
from tests.pipeline.conftest import ROOT

STAGES: dict[str, Any] = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
VARIANT_FILES = sorted((ROOT / "conf/variant").glob("*.yaml"))
MOST_CODE_ENTRIES = 70
PACKAGE = "src/shaftpose/"
# dvc.yaml explains why they are not listed.
NOT_LISTED = {"farm", "tracking"}
# Metrics of a training only describe it, in its curves: another metric trains nothing again.
NOT_OF_STAGE = {
    "detector": {"metrics", "metrics/detection"},
    "train": {"metrics", "metrics/detection"},
}
# Folders within folders that stages list by themselves.
SUBFOLDERS = {"metrics/detection"}
# Code that a stage imports by a class name in a file of conf/.
NAMED_IN_CONF = {"detector": {"network"}, "train": {"network", "refinement"}, "export": {"network"}}

# Attributes of `Settings` -> parameters in dvc.yaml. Sizes are listed one by one.
PARAMETERS = {
    "rendering": {"camera", "poses", "shaft", "scene", "lens", "render"},
    "stand_in": {"camera", "poses", "shaft", "scene", "lens", "render", "real"},
}
# Code of the package that stages hand all settings.
RECEIVERS = {
    "train": "training/recipe.py",
    "detector": "training/recipe.py",
    "evaluate": "evaluation/model_results.py",
}
# Paths, place of computation and tracking.
FREE = {"overrides", "out", "results", "model_folder", "tracking", "cluster", "variant.name"}
WITHOUT_EFFECT = {
    # Used only for validation metrics, and as a name.
    "train": {"detection", "profile"},
    # Building a network needs only the shape of the loss; the file states parts of the shaft.
    "export": {"loss", "render", "scene", "lens", "shaft"},
    # Of the rendering, it reads poses and shaft.
    "evaluate": {"camera", "scene", "lens", "render"},
    # A silhouette depends only on camera, lens and shaft.
    "evaluate_real": {"poses", "scene", "render"},
    "validate": {"render"},
    # Listed key by key.
    "backgrounds": {"backgrounds"},
}


def entries(stage: str, kind: str) -> list[Any]:
    found: list[Any] = STAGES[stage].get(kind, [])
    return found


def paths(stage: str, kind: str) -> set[str]:
    return {
        p for entry in entries(stage, kind) for p in ([entry] if isinstance(entry, str) else entry)
    }


def script(stage: str) -> Path:
    found = re.search(r"pipelines/\w+\.py", STAGES[stage]["cmd"])
    assert found
    return ROOT / found.group()


def folders_reached(stage: str) -> set[str]:
    """The folders, or single files, of the package that the stage's script imports code from."""
    files = source_files(imported_names(ast.parse(script(stage).read_text())))
    names = [path.relative_to(ROOT / PACKAGE) for path in files]
    parts = {p if (p := name.parent.as_posix()) in SUBFOLDERS else name.parts[0] for name in names}
    return (parts | NAMED_IN_CONF.get(stage, set())) - NOT_LISTED - NOT_OF_STAGE.get(stage, set())


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_lists_the_code_that_it_reaches_and_no_other(stage: str) -> None:
    listed = {p.removeprefix(PACKAGE) for p in paths(stage, "deps") if p.startswith(PACKAGE)}
    reached = folders_reached(stage)
    assert listed == {part for part in reached if part.partition("/")[0] not in reached - {part}}
    assert script(stage).relative_to(ROOT).as_posix() in paths(stage, "deps")


def test_the_list_of_code_is_short() -> None:
    code = [p for s in STAGES for p in paths(s, "deps") if p.startswith(("src/", "pipelines/"))]
    assert len(code) <= MOST_CODE_ENTRIES


EVALUATING = {"evaluate", "evaluate_real", "report"}


@pytest.mark.parametrize(
    ("file", "stages"),
    [
        ("metrics/metrics.py", EVALUATING),
        ("metrics/detection/matching.py", {"export", *EVALUATING}),
        ("evaluation/model_results.py", EVALUATING),
        ("report/page.py", {"report"}),
        ("farm/shard_task.py", set()),
    ],
)
def test_a_changed_file_runs_these_stages_and_no_others(file: str, stages: set[str]) -> None:
    assert (ROOT / PACKAGE / file).is_file()
    assert stages_run_by(f"{PACKAGE}{file}") == stages


def stages_run_by(changed: str) -> set[str]:
    """The stages that depend on a file, or on what these stages write."""
    found, outputs = set[str](), {changed}
    while True:
        more = {name for name in STAGES if depends(name, outputs)}
        if more == found:
            return found
        found = more
        outputs |= {out for name in found for kind in WRITTEN for out in paths(name, kind)}


WRITTEN = "outs", "metrics", "plots"


def depends(stage: str, files: set[str]) -> bool:
    """Whether one of the files is a dependency of the stage, lies in one, or holds one."""
    pairs = ((f"{file}/", f"{dep}/") for file in files for dep in paths(stage, "deps"))
    return any(file.startswith(dep) or dep.startswith(file) for file, dep in pairs)


def settings_read(stage: str) -> set[str]:
    """`settings.a.b` -> a.b, in the stage's script and in the code that receives all settings."""
    receivers = [ROOT / PACKAGE / RECEIVERS[stage]] if stage in RECEIVERS else []
    texts = [path.read_text() for path in (script(stage), *receivers)]
    return {
        name
        for text in texts
        for name in re.findall(r"(?<!\.)\bsettings\.([a-z_]+(?:\.[a-z_]+)?)", text)
    }


def parameters_read(stage: str) -> set[str]:
    found: set[str] = set()
    for name in settings_read(stage) - FREE:
        part = name.partition(".")[0]
        found |= (
            PARAMETERS.get(name) or PARAMETERS.get(part) or {name if part in ("split",) else part}
        )
    return found - FREE


def parameters_listed(stage: str) -> set[str]:
    """Top-level keys; sizes of a profile as `size`, a variant's file as `variant`."""
    found = set()
    for entry in entries(stage, "params"):
        for file, keys in ({"params.yaml": [entry]} if isinstance(entry, str) else entry).items():
            if file == "params.yaml":
                found |= {key.partition(".")[0] for key in keys}
            else:
                folder = file.split("/")[1]
                found.add({"profiles.yaml": "size", "config.yaml": "trainer"}.get(folder, folder))
    return found


@pytest.mark.parametrize("stage", [name for name in STAGES if name != "detector"])
def test_a_stage_lists_the_settings_that_it_reads(stage: str) -> None:
    read = parameters_read(stage) - WITHOUT_EFFECT.get(stage, set())
    assert read <= parameters_listed(stage)


def test_the_detector_lists_what_train_lists_but_for_poses_and_real_images() -> None:
    def listed(stage: str) -> set[str]:
        text = str(entries(stage, "params")).replace("${item.variant}", "detector")
        return set(re.findall(r"[\w.${}/]+", text))

    of_e = {"shaft", "lens", "lens.distortion"}
    assert listed("train") - listed("detector") == {"${profile}.steps", *of_e}
    assert listed("detector") - listed("train") == {
        "loss.alpha", "camera.size_px", "${profile}.detector_steps"
    }  # fmt: skip
    extra = paths("train", "deps") - paths("detector", "deps")
    assert extra == {"data/real", "models/detector/model.ckpt", f"{PACKAGE}refinement"}


def keys_listed(stage: str) -> dict[str, list[str]]:
    """File -> keys of it that the stage lists."""
    of_params = [one for one in entries(stage, "params") if isinstance(one, str)]
    listed = {"params.yaml": of_params}
    for entry in entries(stage, "params"):
        listed |= entry if isinstance(entry, dict) else {}
    return listed


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_lists_a_section_of_the_preset_with_that_of_params(stage: str) -> None:
    sections = yaml.safe_load((ROOT / "conf/preset/none.yaml").read_text()).keys()
    listed = keys_listed(stage)
    of_params = {key.partition(".")[0] for key in listed["params.yaml"]}
    assert set(listed.get("conf/preset/${preset}.yaml", [])) == of_params & sections


@pytest.mark.parametrize("path", VARIANT_FILES, ids=lambda p: p.stem)
def test_a_training_lists_the_settings_that_its_variants_file_refers_to(path: Path) -> None:
    listed = keys_listed("detector" if path.stem == "detector" else "train")
    sizes = [key.replace("${profile}", "size") for key in listed["conf/profiles.yaml"]]
    for name in re.findall(r"\$\{([\w.]+)\}", path.read_text()):
        assert any(f"{name}.".startswith(f"{key}.") for key in [*listed["params.yaml"], *sizes])


@pytest.mark.parametrize("path", VARIANT_FILES, ids=lambda p: p.stem)
def test_a_training_lists_all_of_its_variants_file_but_the_title(path: Path) -> None:
    stage, name = ("detector",) * 2 if path.stem == "detector" else ("train", "${item.variant}")
    listed = keys_listed(stage)[f"conf/variant/{name}.yaml"]
    assert {*listed, "title"} == yaml.safe_load(path.read_text()).keys()


def test_every_profile_has_the_listed_sizes() -> None:
    names = set(re.findall(r"\$\{profile\}\.(\w+)", (ROOT / "dvc.yaml").read_text()))
    for profile, sizes in yaml.safe_load((ROOT / "conf/profiles.yaml").read_text()).items():
        assert names <= sizes.keys(), f"{profile} lacks {names - sizes.keys()}"


def test_the_trainer_is_the_one_that_conf_chooses() -> None:
    defaults = yaml.safe_load((ROOT / "conf/config.yaml").read_text())["defaults"]
    (chosen,) = [entry["trainer"] for entry in defaults if "trainer" in entry]
    listed = set(re.findall(r"conf/trainer/(\w+)\.yaml", (ROOT / "dvc.yaml").read_text()))
    assert listed == {chosen}


def test_git_ignores_what_dvc_caches() -> None:
    """Else DVC writes a file `.gitignore` of its own and asks to add it, which Git refuses."""
    cached = [
        entry.replace("${item.variant}", "d")
        for stage in STAGES
        for kind in WRITTEN
        for entry in entries(stage, kind)
        if isinstance(entry, str)
    ]
    command = ["git", "check-ignore", "--no-index", "--stdin"]
    found = subprocess.run(
        command, input="\n".join(cached), cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert set(found.stdout.splitlines()) == set(cached)
    kept = sorted(paths_kept())
    assert subprocess.run([*command[:-1], *kept], cwd=ROOT, capture_output=True).returncode == 1


def test_the_registered_model_is_what_a_stage_writes() -> None:
    (model,) = yaml.safe_load((ROOT / "dvc.yaml").read_text())["artifacts"].values()
    assert model["path"].replace("/e/", "/${item.variant}/") in paths("export", "outs")


def paths_kept() -> set[str]:
    """What Git holds of the stages' results."""
    listed = (entry for stage in STAGES for kind in WRITTEN for entry in entries(stage, kind))
    found = {path for entry in listed if isinstance(entry, dict) for path in entry}
    tables = {f"reports/plots/{name}.csv" for name in ("variants", "mAP", "tip_mm", "axis_deg")}
    return {path.replace("${item.variant}", "d") for path in found - {"reports/plots"}} | tables


def test_the_page_draws_the_stages_as_dvc_does() -> None:
    """`dvc dag --md`, with one node for all variants of a stage."""
    page = (ROOT / "docs/pipeline.md").read_text()
    drawn = set(re.findall(r"(\w+) --> (\w+)", page))
    made = {stage: {out for kind in WRITTEN for out in paths(stage, kind)} for stage in STAGES}
    edges = {
        (maker, stage)
        for stage in STAGES
        for maker, outs in made.items()
        for dep in paths(stage, "deps")
        for out in outs
        if f"{dep}/".startswith(f"{out}/") or f"{out}/".startswith(f"{dep}/")
    }
    assert drawn == edges, "\n".join(f"    {a} --> {b}" for a, b in sorted(edges))
