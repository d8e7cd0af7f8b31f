"""The models folder that BOP's tools expect."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from shaftpose.rendering.bop_models import write_models
from shaftpose.rendering.meshes import shaft_mesh
from shaftpose.rendering.shapes import Shape


def rod(diameter_mm: float = 3.0, length_mm: float = 150.0, revolved: bool = True) -> Shape:
    mesh = shaft_mesh(diameter_mm, length_mm)
    return Shape(mesh, diameter_mm, length_mm, is_rod=True, revolved=revolved)


def test_models_folder_describes_the_mesh(tmp_path: Path) -> None:
    write_models(tmp_path / "models", rod())
    info = json.loads((tmp_path / "models" / "models_info.json").read_text())["1"]
    assert info["symmetries_continuous"] == [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]
    # A rod of 3 mm x 150 mm from the tip; its diagonal is sqrt(9 + 22500) = 150.03.
    assert [info[f"min_{axis}"] for axis in "xyz"] == pytest.approx([-1.5, -1.5, 0.0])
    assert [info[f"size_{axis}"] for axis in "xyz"] == pytest.approx([3.0, 3.0, 150.0])
    assert info["diameter"] == pytest.approx(150.03, abs=0.001)
    write_models(tmp_path / "jaws", rod(revolved=False))
    info = json.loads((tmp_path / "jaws" / "models_info.json").read_text())["1"]
    assert "symmetries_continuous" not in info


def test_the_ply_file_holds_the_mesh_in_triangles(tmp_path: Path) -> None:
    write_models(tmp_path, rod())
    mesh = rod().mesh
    head, _, body = (tmp_path / "obj_000001.ply").read_text().partition("end_header\n")
    assert head.startswith("ply\nformat ascii 1.0\n")
    assert f"element vertex {len(mesh.vertices)}\n" in head
    faces = body.splitlines()[len(mesh.vertices) :]
    assert f"element face {len(faces)}\n" in head
    assert {line.split()[0] for line in faces} == {"3"}
    read = trimesh.load(tmp_path / "obj_000001.ply")
    np.testing.assert_allclose(read.extents, [3, 3, 150], atol=1e-5)
    # Closed, with the volume of a prism whose base is inscribed in the rod's circle.
    sides = sum(len(face) == 4 for face in mesh.faces)
    base = sides / 2 * 1.5**2 * np.sin(2 * np.pi / sides)
    assert read.is_watertight
    assert read.volume == pytest.approx(150 * base, rel=1e-4)


def test_models_that_are_written_again_leave_links_to_the_old_files(tmp_path: Path) -> None:
    """DVC's cache may hold such links."""
    write_models(tmp_path / "models", rod())
    files = ("models_info.json", "obj_000001.ply")
    before = {name: (tmp_path / "models" / name).read_text() for name in files}
    for name in files:
        (tmp_path / name).hardlink_to(tmp_path / "models" / name)
    write_models(tmp_path / "models", rod(6.0, 300.0))
    for name in files:
        assert (tmp_path / name).read_text() == before[name]
        assert (tmp_path / "models" / name).read_text() != before[name]
