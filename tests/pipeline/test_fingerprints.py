"""Each setting changes the fingerprints of the results that it determines, and no others."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest
import trimesh
from omegaconf import DictConfig, OmegaConf

from shaftpose.core.background_index import Background
from shaftpose.core.errors import InputError
from shaftpose.rendering import stand_in_sets
from shaftpose.rendering.image_sets import rendered_sets
from shaftpose.settings import tree
from shaftpose.settings.compose import composed
from shaftpose.settings.stage import resolved_settings
from shaftpose.settings.tree import Settings
from shaftpose.stage_files import DataRecord
from shaftpose.training import fingerprint
from shaftpose.training.recipe import training_recipe
from tests.pipeline.conftest import ROOT

DATA = DataRecord(start=None, training_images=1, digest="", mixed_in=None)

IMAGES, CLEAR, OCCLUDED = "images", "clear", "occluded"
RENDERED = {IMAGES, CLEAR, OCCLUDED}
STAND_IN_TEST = {"stand-in clear", "stand-in occluded"}
STAND_IN = {"stand-in train", *STAND_IN_TEST}
EVERY_SET = RENDERED | STAND_IN
POSED = {"d"}
PAPERS = POSED | {"detector"}  # with the paper's backbone
TRAININGS = PAPERS | {"e"}

# Setting, or section with all of its settings -> what it determines, given the files that other
# stages write. The longest name counts.
DETERMINES: dict[str, set[str]] = {
    "profile": set(),
    "preset": set(),
    "seed": EVERY_SET | TRAININGS,
    "variants": set(),
    "camera.size_px": EVERY_SET | TRAININGS,  # which the paper's networks refuse
    "camera.view_deg": EVERY_SET | {"e"},
    "poses": EVERY_SET | PAPERS,
    "shaft": EVERY_SET | {"e"},
    "backgrounds": set(),
    "backgrounds.held_out": RENDERED,
    "scene": EVERY_SET,
    "scene.occluder_probability": {IMAGES},
    "scene.occluder_coverage": {IMAGES, CLEAR, "stand-in clear"},
    "scene.crossing_probability": {IMAGES},
    **{
        f"scene.{name}": RENDERED
        for name in ("light_strength", "light_kelvin", "ambient", "steel_grey", "roughness")
    },
    "lens": EVERY_SET,
    "lens.distortion": EVERY_SET | {"e"},
    **{f"lens.{name}": RENDERED for name in ("blur_px", "haze", "vignette", "noise")},
    "render": EVERY_SET,
    "cluster": set(),
    "split": set(),
    "real.source": set(),
    "real.stand_in": STAND_IN,
    "loss": POSED,
    "loss.alpha": PAPERS,
    "training": TRAININGS,
    "training.loader_workers": set(),
    "training.images_in_memory": set(),
    "training.checkpoint_minutes": set(),
    "training.max_hours": set(),
    "detection": set(),
    "report": set(),
    "tracking": set(),
    "size.sources": set(),
    "size.variations": set(),
    "size.images": {IMAGES},
    "size.images_per_shard": {IMAGES},  # at most half of a set is in a shard
    "size.samples": EVERY_SET,
    "size.test_set": {CLEAR, OCCLUDED, *STAND_IN_TEST},
    "size.stand_in_images": {"stand-in train"},
    "size.width": PAPERS,
    "size.depth": PAPERS,
    "size.symmetries": PAPERS,
    "size.batch_size": TRAININGS,
    "size.detector_steps": {"detector"},
    "size.steps": TRAININGS - {"detector"},
    "size.warmup_steps": TRAININGS,
    "size.validate_every": TRAININGS,
    "size.optimizer": TRAININGS,
    "size.learning_rate": TRAININGS,
    "size.precision": TRAININGS,
    "trainer": TRAININGS,
    "variant": TRAININGS,
    "variant.title": set(),
    "overrides": set(),
    "out": set(),
    "results": set(),
    "model_folder": set(),
}

# Values before the changes, also those that conf/trainer/cpu.yaml leaves out. Symmetries need equal
# ranges of x and y.
START = (
    "profile=smoke", "profiles.smoke.symmetries=false", "trainer=cpu", "+trainer.num_nodes=1",
    "+trainer.strategy=auto", "+trainer.sync_batchnorm=false", "+trainer.benchmark=null",
)  # fmt: skip

# Other values of settings for which `another` knows none.
OTHERS: dict[str, Any] = {
    "profile": "other",
    "preset": "other",
    "variants": ["b"],
    "poses.yaw_deg": [1.0, 359.0],
    "shaft.tip": "rounded",
    "shaft.cad": {"file": "tool.stl", "unit": "mm"},
    "backgrounds.source": "mine",
    "backgrounds.held_out": 0.2,
    "scene.light_shape": "ring",
    "lens.jpeg_quality": [50, 90],
    "lens.field_px": 400.0,
    "render.device": "cuda",
    "cluster.address": "tcp://host:1",
    "cluster.slurm": {"queue": "q", "cores": 1, "memory": "1GB", "walltime": "1", "jobs": 1},
    "split.method": "random",
    "real.source": "mine",
    "training.loader_workers": 1,
    "training.max_hours": 1.0,
    "training.on_damaged": "skip",
    "training.gradient_clip": 1.0,
    "training.ema_decay": 0.9,
    "training.patience": 1,
    "detection.refine": "none",
    "detection.confidence_threshold": 0.5,
    "tracking.uri": "http://host",
    "tracking.experiment": "other",
    "size.width": 0.25,
    "size.symmetries": True,
    "size.warmup_steps": 1,
    "size.optimizer": "adam",
    "size.precision": "bf16-mixed",
    "trainer.accelerator": "gpu",
    "trainer.strategy": "ddp",
    "trainer.benchmark": True,
    "variant.name": "other",
    "variant.title": "other",
    "variant.network": {"_target_": "shaftpose.other"},
    "variant.loss": {"_target_": "shaftpose.other"},
    "overrides": ["other=1"],
    "out": "other",
    "results": "other",
    "model_folder": "other",
}


def another(name: str, value: Any) -> Any:
    """A valid value of a setting that differs from its value."""
    if name in OTHERS:
        return OTHERS[name]
    if name == "variant.start":
        return None if value else "model.ckpt"
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, float):
        return 0.9 * value or 0.1
    first, *others = value
    if others and first < others[-1]:  # a range
        return [first + type(first)(1 if isinstance(first, int) else 0.1), *others]
    return [*value[:-1], value[-1] + (1 if isinstance(value[-1], int) else 0.1)]


def leaves(part: object, prefix: str = "") -> Iterator[str]:
    """The names of the settings inside a dataclass."""
    for field in fields(part):  # type: ignore[arg-type]
        value, name = getattr(part, field.name), f"{prefix}{field.name}"
        yield from leaves(value, f"{name}.") if is_dataclass(value) else [name]


def determined(name: str) -> set[str]:
    """The entry of the table. Raises KeyError if there is none."""
    parts = name.split(".")
    sections = (".".join(parts[:n]) for n in range(len(parts), 0, -1))
    for section in sections:
        if section in DETERMINES:
            return DETERMINES[section]
    raise KeyError(f"{name}: new? Add to the table what it determines")


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Background]:
    """Backgrounds and an instrument in the working directory."""
    monkeypatch.chdir(tmp_path)
    trimesh.creation.cylinder(radius=2, height=90).export("tool.stl")
    monkeypatch.setattr(stand_in_sets, "_backgrounds", lambda *args, **named: {})
    monkeypatch.setattr(tree, "check_variants", lambda *args: None)
    for n in range(20):
        Path(f"{n}.jpg").write_bytes(bytes([n]))
    return [Background(Path(f"{n}.jpg"), str(n)) for n in range(20)]


def set_fingerprints(settings: Settings, library: list[Background]) -> dict[str, str]:
    """The fingerprint of each rendered set."""
    held_out, size, seed = settings.backgrounds.held_out, settings.size, settings.seed
    sets = rendered_sets(settings.rendering, size, library, held_out, seed)
    stand_in = stand_in_sets.stand_in_sets(settings.stand_in, size, seed, Path("stand-in"))
    sets |= {f"stand-in {name}": one for name, one in stand_in.items()}
    return {name: one.fingerprint() for name, one in sets.items()}


def training_fingerprint(settings: Settings) -> str:
    """The fingerprint of a training on given data, or why it is refused."""
    try:
        return fingerprint.fingerprint(training_recipe(settings).resolved(), DATA)
    except InputError as error:
        return str(error)


@contextmanager
def changed(config: DictConfig, name: str) -> Iterator[None]:
    """Give a setting another value."""
    key = name.replace("size.", "profiles.smoke.") if name.startswith("size.") else name
    before = OmegaConf.select(config, key)
    if name not in ("profile", "preset"):  # names, whose values are in other settings
        OmegaConf.update(config, key, another(name, before), merge=False)
    yield
    OmegaConf.update(config, key, before, merge=False)


def test_each_setting_changes_what_it_determines_and_nothing_else(
    library: list[Background], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fingerprint, "code_files", lambda _: [])
    monkeypatch.setattr(fingerprint, "_PACKAGES", ())
    configs = {name: composed(ROOT, f"variant={name}", *START) for name in sorted(TRAININGS)}
    configs["e"].variant.symmetries = False
    every = {name: resolved_settings(config, ROOT) for name, config in configs.items()}
    sets = set_fingerprints(every["d"], library)
    trainings = {name: training_fingerprint(settings) for name, settings in every.items()}
    wrong = {}
    for name in leaves(every["d"]):
        found = set()
        for variant, config in configs.items():
            with changed(config, name):
                settings = resolved_settings(config, ROOT)
            if training_fingerprint(settings) != trainings[variant]:
                found.add(variant)
            if variant == "d":
                own = set_fingerprints(settings, library)
                found |= {one for one in own if own[one] != sets[one]}
        if found != determined(name):
            wrong[name] = {"changes": found, "should": determined(name)}
    assert not wrong, json.dumps(wrong, indent=1, default=sorted)
