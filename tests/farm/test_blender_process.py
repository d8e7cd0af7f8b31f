"""A shard's process uses only its core and does not repeat known warnings."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh

from shaftpose.core.shard_writer import shard_name
from shaftpose.farm.blender_process import IMAGE_DONE
from shaftpose.farm.set_folder import write_set
from shaftpose.rendering.rendered_set import RenderedSet, Shard
from shaftpose.settings.schema import CadSettings, RenderSettings
from tests.rendering.blender_process import run_python

START = """
import os
import threading
from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.farm.blender_process import start_generator
sources = {Path(path): source for path, source in backgrounds}
rendered = RenderedSet(settings, sources, seed=1, images=1, images_per_shard=1)
cores = os.sched_getaffinity(0)
if alone:
    generator = start_generator(rendered)
else:
    from shaftpose.rendering.generator import SampleGenerator
    generator = SampleGenerator(settings, sources, 1)
generator.sample(0)
seen = {"threads": len(os.listdir("/proc/self/task")), "kept": cores == os.sched_getaffinity(0)}
Path("seen.json").write_text(json.dumps(seen))
"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="Linux alone can be told")
@pytest.mark.skipif(os.cpu_count() == 1, reason="one core needs no telling")
def test_blender_starts_no_threads_for_other_cores(
    settings: RenderSettings, backgrounds: Mapping[Path, str], tmp_path: Path
) -> None:
    seen = {}
    for alone in (True, False):
        listed = [(str(path), source) for path, source in backgrounds.items()]
        run_python(START, tmp_path, settings, backgrounds=listed, alone=alone)
        seen[alone] = json.loads((tmp_path / "seen.json").read_text())
    assert seen[True]["threads"] < seen[False]["threads"]
    assert seen[True]["kept"]  # compositing and compression may use all cores


def test_what_a_cad_file_is_warned_of_is_not_said_by_each_shard(
    settings: RenderSettings, backgrounds: Mapping[Path, str], tmp_path: Path
) -> None:
    trimesh.creation.cylinder(1.5, 50.0).export(tmp_path / "short.stl")
    shaft = replace(settings.shaft, cad=CadSettings(tmp_path / "short.stl", "mm"))
    shard = Shard(tmp_path / shard_name(0), 0, 1)
    write_set(RenderedSet(replace(settings, shaft=shaft), backgrounds, 1, 1, 1), tmp_path)
    command = [sys.executable, "-m", "shaftpose.farm.blender_process", str(shard.path), "0", "1"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout
        assert process.stdout.read() == f"{IMAGE_DONE}\n"
    assert shard.is_finished()
