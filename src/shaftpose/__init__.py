"""Find surgical instrument shafts in one endoscope image and give each its 5-DoF pose."""

import os
from importlib import import_module
from typing import Any

# OpenCV refuses an image that states more pixels before it decodes it. It reads the limit when it
# is first imported.
MOST_PIXELS = "OPENCV_IO_MAX_IMAGE_PIXELS"
os.environ.setdefault(MOST_PIXELS, "100000000")


def __getattr__(name: str) -> Any:
    """`load` and `__version__`, found when they are first used: the package itself is light."""
    if name == "load":
        return import_module("shaftpose.inference.loading").load
    if name == "__version__":
        return import_module("importlib.metadata").version("shaftpose")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
