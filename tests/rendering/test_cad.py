"""CAD files of an instrument of known size and position, in all formats and orientations."""

import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from trimesh import Trimesh

from shaftpose.core.errors import InputError
from shaftpose.rendering.cad import cad_mesh
from shaftpose.settings.schema import CadSettings

Array = NDArray[np.float64]

# Columns: directions of the file's axes; z is along the instrument.
AXES = {"x": np.roll(np.eye(3), 1, axis=0), "y": np.roll(np.eye(3), 2, axis=0), "z": np.eye(3)}


def instrument() -> Trimesh:
    """A shaft of 3 mm and 100 mm with a thick handle to one side, from z = 0 to z = 120 mm."""
    shaft = trimesh.creation.cylinder(1.5, segment=[[0, 0, 0], [0, 0, 100]], sections=64)
    handle = trimesh.creation.box([8, 8, 20])
    handle.apply_translation([2, 0, 110])
    return trimesh.util.concatenate([shaft, handle])


def write(body: Trimesh, path: Path) -> Path:
    body.export(path)
    return path


def moved(body: Trimesh, rotation: Array, shift: Array) -> Trimesh:
    body.vertices = body.vertices @ rotation.T + shift
    return body


def random_rotation(seed: int) -> Array:
    rotation, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return rotation * np.sign(np.linalg.det(rotation))


def assert_in_shaft_frame(vertices: Array) -> None:
    """The instrument's tip is at the origin and its handle, off the axis, at z = 100 .. 120."""
    assert vertices[:, 2].min() == pytest.approx(0, abs=1e-3)
    assert vertices[:, 2].max() == pytest.approx(120, abs=1e-3)
    shaft, handle = vertices[vertices[:, 2] < 99], vertices[vertices[:, 2] > 101]
    np.testing.assert_allclose(np.hypot(*shaft[:, :2].T).max(), 1.5, atol=0.05)
    centre = np.linalg.norm((handle.min(axis=0) + handle.max(axis=0))[:2] / 2)
    assert centre == pytest.approx(2, abs=0.05)
    assert np.hypot(*handle[:, :2].T).max() == pytest.approx(52**0.5, abs=0.05)  # 6, 4


@pytest.mark.parametrize("suffix", ["stl", "obj", "glb", "STL"])
def test_formats(suffix: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write(instrument(), tmp_path / f"tool.{suffix.lower()}").rename(tmp_path / f"a.{suffix}")
    with caplog.at_level(logging.INFO, logger="shaftpose"):
        mesh = cad_mesh(CadSettings(path, "mm", axis="z", tip="low"))
    assert_in_shaft_frame(mesh.vertices)
    # The handle's edges are 6 and 4 mm from the axis.
    assert [(r.levelname, r.getMessage()) for r in caplog.records] == [
        ("INFO", f"{path}: 120 mm long and up to 14.4 mm thick, read in mm")
    ]
    assert {len(face) for face in mesh.faces} == {3}
    assert mesh.uv.shape == (3 * len(mesh.faces), 2)
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume > 0


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("tip", ["low", "high"])
def test_axis_and_end_can_be_named(axis: str, tip: str, tmp_path: Path) -> None:
    upside_down = np.diag([1.0, -1.0, -1.0]) if tip == "high" else np.eye(3)
    body = moved(instrument(), AXES[axis] @ upside_down, np.array([30.0, -5.0, 70.0]))
    mesh = cad_mesh(CadSettings(write(body, tmp_path / "tool.stl"), "mm", axis, tip))
    assert_in_shaft_frame(mesh.vertices)


@pytest.mark.parametrize("seed", range(4))
def test_axis_and_end_are_found(seed: int, tmp_path: Path) -> None:
    """Along the principal axis, slightly tilted by the handle, with the tip at the thinner end."""
    body = moved(instrument(), random_rotation(seed), np.array([30.0, -5.0, 70.0]))
    vertices = cad_mesh(CadSettings(write(body, tmp_path / "tool.stl"), "mm")).vertices
    shaft, handle = vertices[vertices[:, 2] < 60], vertices[vertices[:, 2] > 100]
    assert shaft[:, 2].min() == pytest.approx(0, abs=1e-3)
    assert np.hypot(*shaft[:, :2].T).max() == pytest.approx(1.5, abs=0.2)
    assert np.hypot(*handle[:, :2].T).max() > 5
    rod = trimesh.creation.cylinder(1.5, segment=[[0, 0, 0], [0, 0, 100]])
    body = moved(rod, random_rotation(seed), np.array([30.0, -5.0, 70.0]))
    vertices = cad_mesh(CadSettings(write(body, tmp_path / "rod.stl"), "mm")).vertices
    np.testing.assert_allclose(np.hypot(*vertices[:, :2].T).max(), 1.5, atol=1e-3)
    np.testing.assert_allclose(vertices[:, 2].max(), 100, atol=1e-3)


@pytest.mark.parametrize(("unit", "mm"), [("cm", 10.0), ("m", 1000.0), ("inch", 25.4)])
def test_units(unit: str, mm: float, tmp_path: Path) -> None:
    body = instrument()
    body.apply_scale(1 / mm)
    path = write(body, tmp_path / "tool.obj")
    assert_in_shaft_frame(cad_mesh(CadSettings(path, unit, axis="z", tip="low")).vertices)


@pytest.mark.parametrize(
    ("file_unit", "read_as", "size"),
    [(1000.0, "mm", "0.008 x 0.008 x 0.12 mm, read in mm"),
     (1.0, "m", "8e+03 x 8e+03 x 1.2e+05 mm, read in m")],
)  # fmt: skip
def test_a_wrong_unit_is_refused_with_a_better_one(
    file_unit: float, read_as: str, size: str, tmp_path: Path
) -> None:
    body = moved(instrument(), np.eye(3), np.array([-0.5, 0, 0]))
    body.apply_scale(1 / file_unit)
    path = write(body, tmp_path / "tool.glb")
    better = {"mm": "m", "m": "mm"}[read_as]
    with pytest.raises(InputError) as caught:
        cad_mesh(CadSettings(path, read_as))
    message = str(caught.value)
    assert message.startswith(f"{path}: measures {size}")
    assert message.endswith(f"try shaft.cad.unit = {better}")
    assert "\n" not in message


@pytest.mark.parametrize(
    ("unit", "length_mm", "diameter_mm", "size"),
    [
        ("cm", 250.0, 5.0, "25 mm long and up to 0.5 mm thick"),
        ("inch", 250.0, 5.0, "9.84 mm long and up to 0.197 mm thick"),
        ("mm", 59.0, 5.0, "59 mm long and up to 5 mm thick"),
        ("mm", 250.0, 16.0, "250 mm long and up to 16 mm thick"),
        ("mm", 250.0, 0.9, "250 mm long and up to 0.9 mm thick"),
    ],
)
def test_an_unusual_size_is_used_with_a_warning(
    unit: str,
    length_mm: float,
    diameter_mm: float,
    size: str,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """An instrument in cm or inch has an unusual size when read in mm."""
    rod = trimesh.creation.cylinder(diameter_mm / 2, length_mm, sections=64)
    rod.apply_scale({"mm": 1.0, "cm": 0.1, "inch": 1 / 25.4}[unit])
    path = write(rod, tmp_path / "rod.stl")
    with caplog.at_level(logging.WARNING, logger="shaftpose"):
        cad_mesh(CadSettings(path, "mm"))
        assert [record.getMessage() for record in caplog.records] == [
            f"{path}: {size}, read in mm; expected a length of at least 60 mm and a thickness of 1 "
            "to 15 mm: correct shaft.cad.unit, or remove the parts that never enter the body"
        ]
        caplog.clear()
        cad_mesh(CadSettings(path, unit))
    assert bool(caplog.records) == (unit == "mm")


def test_a_file_that_is_flat_along_its_axis_is_named(tmp_path: Path) -> None:
    sheet = trimesh.Trimesh([[0, 0, 0], [100, 0, 0], [0, 3, 0]], [[0, 1, 2]])
    path = write(sheet, tmp_path / "sheet.stl")
    with pytest.raises(InputError, match=f"^{path}: flat along z; set shaft.cad.axis"):
        cad_mesh(CadSettings(path, "mm", axis="z"))


def test_a_size_that_no_unit_explains(tmp_path: Path) -> None:
    body = instrument()
    body.apply_scale(1e-6)
    with pytest.raises(InputError, match="check the file"):
        cad_mesh(CadSettings(write(body, tmp_path / "tool.obj"), "mm"))


@pytest.mark.parametrize("name", ["tool.stl", "tool.obj", "tool.glb"])
@pytest.mark.parametrize("content", [b"", b"this is no mesh", bytes(range(256)) * 4])
def test_an_unreadable_file_is_named(name: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"cannot be read|holds no triangles") as caught:
        cad_mesh(CadSettings(path, "mm"))
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_another_format_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"missing\.stl: cannot be read"):
        cad_mesh(CadSettings(tmp_path / "missing.stl", "mm"))
    with pytest.raises(InputError, match=r"tool\.step: not an STL, OBJ or GLB file"):
        cad_mesh(CadSettings(tmp_path / "tool.step", "mm"))


def test_a_mesh_with_a_hole_is_used_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    body = instrument()
    body.update_faces(np.arange(len(body.faces)) != 5)
    path = write(body, tmp_path / "open.stl")
    with caplog.at_level(logging.WARNING, logger="shaftpose"):
        mesh = cad_mesh(CadSettings(path, "mm", axis="z", tip="low"))
    assert_in_shaft_frame(mesh.vertices)
    assert [r.getMessage() for r in caplog.records] == [
        f"{path} is not watertight: masks may show its holes; close them in your CAD program"
    ]
