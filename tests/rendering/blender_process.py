"""Runs Python code in a separate process, because Blender holds one scene per process."""

import json
import subprocess
import sys
from pathlib import Path

from shaftpose.settings.parsing import to_json
from shaftpose.settings.schema import RenderSettings


def start_python(
    script: str, folder: Path, settings: RenderSettings, **arguments: object
) -> subprocess.Popen[str]:
    """Start `script`, with `settings` and `arguments` (JSON values) as variables.

    It leads its own process group, so a test can kill it with all its workers.
    """
    (folder / "settings.json").write_text(to_json(settings))
    lines = [
        "import json",
        "from pathlib import Path",
        "from shaftpose.stage_files import read_stage_file",
        "from shaftpose.settings.schema import RenderSettings",
        f"settings = read_stage_file(Path({str(folder / 'settings.json')!r}), RenderSettings, '')",
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
    """Run `script` to its end; on failure its output is the message."""
    process = start_python(script, folder, settings, **arguments)
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 0, output
