"""Where results come from: the command, the code and the machine."""

import os
import platform
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Origin:
    """How results were made.

    command: as in a shell. commit: of the code; ends with `+` if Python or YAML files were changed
    or not committed, or git could not tell; "" outside of a Git repository. machine: processor and
    number of cores.
    """

    command: str
    commit: str
    machine: str


def origin() -> Origin:
    """The origin of this process's results, if its working directory is the project's."""
    return Origin(
        command=shlex.join(["python", *sys.argv]),
        commit=_commit(),
        machine=f"{processor()}, {os.cpu_count()} cores",
    )


def _commit() -> str:
    head = _git("rev-parse", "--short=12", "HEAD")
    if head is None:
        return ""
    changed = _git("status", "--porcelain", "--untracked-files=all", "--", "*.py", "*.yaml")
    return head if changed == "" else f"{head}+"


def _git(*arguments: str) -> str | None:
    """The output of a git command; None if it fails or git is missing."""
    try:
        done = subprocess.run(
            ["git", "--no-optional-locks", *arguments], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def processor() -> str:
    """The processor's architecture and, if the system tells it, its name."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{platform.machine()} {names[0] if names else platform.processor()}".strip()
