"""Runs a piece of Python in a process of its own: Blender holds one scene per process."""

import json
import subprocess
import sys
from pathlib import Path

from shaftpose.config import RenderSettings, to_json


def start_python(
    script: str, folder: Path, settings: RenderSettings, **arguments: object
) -> subprocess.Popen[str]:
    """Start `script`, which finds `settings` and `arguments` (JSON values) as variables.

    It leads a process group of its own, so that a test may kill it with all its workers.
    """
    (folder / "settings.json").write_text(to_json(settings))
    lines = [
        "import json",
        "from pathlib import Path",
        "from shaftpose.config import RenderSettings, from_json",
        f"settings = from_json(RenderSettings, Path({str(folder / 'settings.json')!r}))",
        f"globals().update(json.loads({json.dumps(arguments)!r}))",
        script,
    ]
    path = folder / "script.py"
    path.write_text("\n".join(lines))
    return subprocess.Popen(
        [sys.executable, str(path)],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def run_python(script: str, folder: Path, settings: RenderSettings, **arguments: object) -> None:
    """Run `script` to its end; its output is the message of the failure."""
    process = start_python(script, folder, settings, **arguments)
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 0, output
