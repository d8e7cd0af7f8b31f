"""The instrument's mesh and metadata in the form that BOP's tools expect."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.files import new_file, write_json
from shaftpose.core.shard_schema import SHAFT_OBJECT_ID
from shaftpose.rendering.shapes import Shape


def write_models(folder: Path, shape: Shape) -> None:
    """Write BOP's models folder: the mesh in triangles, and `models_info.json`.

    BOP's diameter is approximated by the diagonal of the rod around the mesh.
    """
    vertices_mm = shape.mesh.vertices
    low, size = vertices_mm.min(axis=0), np.ptp(vertices_mm, axis=0)
    info: dict[str, dict[str, Any]] = {
        str(SHAFT_OBJECT_ID): {
            "diameter": float(np.hypot(shape.diameter_mm, shape.length_mm)),
            **{f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)},
            **{f"size_{axis}": float(value) for axis, value in zip("xyz", size, strict=True)},
        }
    }
    if shape.revolved:
        info[str(SHAFT_OBJECT_ID)]["symmetries_continuous"] = [
            {"axis": [0, 0, 1], "offset": [0, 0, 0]}
        ]
    write_json(folder / "models_info.json", info)
    ply = "\n".join(_ply_lines(vertices_mm, _triangles(shape.mesh.faces)))
    with new_file(folder / f"obj_{SHAFT_OBJECT_ID:06d}.ply") as path:
        path.write_text(f"{ply}\n")


def _triangles(faces: Sequence[Sequence[int]]) -> list[tuple[int, int, int]]:
    """Triangle fans around the first corner of each face."""
    return [(first, *pair) for first, *rest in faces for pair in pairwise(rest)]


def _ply_lines(
    vertices_mm: NDArray[np.float64], triangles: Sequence[tuple[int, int, int]]
) -> Iterator[str]:
    yield "ply\nformat ascii 1.0"
    yield "comment mm; origin at the distal tip, +z towards the handle"
    yield f"element vertex {len(vertices_mm)}"
    yield "property float x\nproperty float y\nproperty float z"
    yield f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header"
    yield from (f"{x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices_mm)
    yield from (f"3 {a} {b} {c}" for a, b, c in triangles)
