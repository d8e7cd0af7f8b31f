"""Cycles' passes as arrays, without intermediate files.

Python cannot read the pixels of a render from Blender's memory, but a render engine can read its
own result. Cycles is registered from Python, so its `render` method is wrapped: after the original
call the passes are copied. This interface is undocumented; a test compares the passes with the EXR
file that Blender writes.
"""

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

Passes = dict[str, NDArray[np.float32]]


class PassReader:
    """Renders the current scene and returns its passes; at most one reader per process."""

    def __init__(self) -> None:
        self._passes: Passes = {}
        engine = _cycles_engine()
        engine.render = self._wrapped(engine.render)

    def render(self) -> Passes:
        """Pass name -> (h, w, channels) float32, top row first, of the border's size."""
        self._passes = {}
        bpy.ops.render.render()
        if not self._passes:
            raise RuntimeError("Blender rendered nothing; see its message above")
        return self._passes

    def _wrapped(self, original: Callable[..., Any]) -> Callable[..., Any]:
        def render(engine: Any, depsgraph: Any) -> None:
            original(engine, depsgraph)
            self._passes = _copy_passes(engine.get_result())

        return render


def _cycles_engine() -> Any:
    for engine in bpy.types.RenderEngine.__subclasses__():
        if getattr(engine, "bl_idname", None) == "CYCLES":
            return engine
    raise RuntimeError("Blender was built without Cycles; install bpy from PyPI")


def _copy_passes(result: Any) -> Passes:
    height, width = result.resolution_y, result.resolution_x
    passes = {}
    for render_pass in result.layers[0].passes:
        flat = np.empty(width * height * render_pass.channels, dtype=np.float32)
        render_pass.rect.foreach_get(flat)
        passes[render_pass.name] = flat.reshape(height, width, -1)[::-1]
    return passes
