"""Check what pip cannot install: Python itself and the system libraries that Blender loads.

Uses only the standard library, so that it can run before anything is installed.
"""

import ctypes
import importlib.util
import sys

# Shared library -> Debian and Ubuntu package.
LIBRARIES = {
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libXt.so.6": "libxt6",
    "libXext.so.6": "libxext6",
    "libGL.so.1": "libgl1",
}


def main() -> None:
    """Name missing packages and the command that installs them; status 1 if any are missing."""
    if sys.version_info[:2] != (3, 11):
        sys.exit(
            f"error: this is Python {sys.version.split()[0]}; Blender's module needs 3.11: install "
            "it with its venv module, or set PYTHON=/path/to/python3.11"
        )
    missing = [package for library, package in LIBRARIES.items() if not _loads(library)]
    if importlib.util.find_spec("ensurepip") is None:
        missing.append("python3.11-venv")
    if missing:
        sys.exit(
            f"error: missing system packages; run: sudo apt-get install -y {' '.join(missing)}"
        )


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


if __name__ == "__main__":
    main()
