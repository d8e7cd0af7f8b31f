"""The process that renders a shard keeps to its core."""

import json
import os
from collections.abc import Mapping
from pathlib import Path

import pytest
from blender_process import run_python

from shaftpose.config import RenderSettings

START = """
import os
import threading
from shaftpose.rendering.jobs import RenderedSet
from shaftpose.rendering.worker import start_generator
sources = {Path(path): source for path, source in backgrounds}
rendered = RenderedSet(settings, sources, seed=1, images=1, images_per_shard=1)
cores = os.sched_getaffinity(0)
if alone:
    generator = start_generator(rendered)
else:
    from shaftpose.rendering.generator import Generator
    generator = Generator(settings, sources, 1)
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
    assert seen[True]["kept"]  # compositing and compression may use what there is
