"""Shafts, jaws and lumps of tissue in Blender's scene, placed again for each image.

Materials are made once for the first, second, ... body and kept. Blender's camera looks along -z
with y up: points of the project's camera frame are converted by the flip (x, -y, -z).
"""

from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Array, ShaftPose
from shaftpose.rendering.coatings import CoatingLayer, coating_picture
from shaftpose.rendering.films import FilmLayer
from shaftpose.rendering.materials import SceneImages, SteelMaterial, TissueMaterial, surface_image
from shaftpose.rendering.meshes import Mesh, lump_mesh
from shaftpose.rendering.scene import Jaws, Occluder, Scene
from shaftpose.rendering.shapes import Shape, jaws_mesh

# Object index of jaws: above any number of shafts, below Blender's limit of 32,767. Lumps have 0,
# like pixels without a body.
TOOL_INDEX = 30_000
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


class Shafts:
    """The annotated instruments; number n has the object index n + 1.

    places: (4, 4) each, from the shaft's frame to the camera's.
    """

    def __init__(self, scene: Any, shape: Shape) -> None:
        self.places: list[Array] = []
        self._scene, self._shape = scene, shape
        self._data = blender_mesh("shaft", shape.mesh, smooth=True)
        self._objects: list[Any] = []
        self._steels: list[SteelMaterial] = []
        self._coatings: list[CoatingLayer] = []
        self._films: list[FilmLayer] = []

    def place(self, poses: Sequence[ShaftPose], rolls_deg: Sequence[float]) -> None:
        """Show one shaft at each pose, and hide the others."""
        while len(self._objects) < len(poses):
            self._add()
        self.places = [_pose_matrix(*pair) for pair in zip(poses, rolls_deg, strict=True)]
        for number, shaft in enumerate(self._objects):
            _show(shaft, number < len(poses))
            if number < len(poses):
                shaft.matrix_world = _to_blender(_FLIP @ self.places[number])

    def dress(self, scene: Scene, images: SceneImages) -> None:
        """Give the placed shafts their steels, coatings and films."""
        for material, steel in zip(self._steels, scene.steels, strict=False):
            material.apply(steel)
        self._coat(scene, images)
        for layer, film in zip_longest(self._films, scene.films[: len(self._films)]):
            layer.apply(film)

    def meshes(self) -> Iterator[tuple[Mesh, Array]]:
        """Each placed mesh, and the matrix (4, 4) from its frame to the camera's."""
        return ((self._shape.mesh, place) for place in self.places)

    def _add(self) -> None:
        number = len(self._objects)
        shaft = bpy.data.objects.new(f"shaft {number}", self._data)
        self._scene.collection.objects.link(shaft)
        steel = SteelMaterial.create(f"steel {number}")
        shaft.material_slots[0].link = "OBJECT"
        shaft.material_slots[0].material = steel.material
        shaft.pass_index = number + 1
        self._objects.append(shaft)
        self._steels.append(steel)
        self._coatings.append(CoatingLayer(steel.material))
        self._films.append(FilmLayer(steel.material))

    def _coat(self, scene: Scene, images: SceneImages) -> None:
        size_mm = np.pi * self._shape.diameter_mm, self._shape.length_mm
        pairs = zip(scene.coatings, scene.steels, strict=False)
        for layer, pair in zip_longest(self._coatings, pairs):
            coating, steel = pair or (None, None)
            if coating is None or steel is None:
                layer.apply(None, None, size_mm)
                continue
            picture = coating_picture(coating, steel, self._shape.diameter_mm, size_mm[1])
            layer.apply(coating, images.add(surface_image(picture)), size_mm)


class Unannotated:
    """Jaws and lumps of tissue, which are no annotated shaft; each image has its own meshes."""

    def __init__(self, scene: Any) -> None:
        self._scene = scene
        self._steels: list[SteelMaterial] = []
        self._tissues: list[TissueMaterial] = []
        self._placed: list[tuple[Any, Mesh]] = []

    def clear(self) -> None:
        """Remove all jaws and lumps from the open file."""
        for body, _ in self._placed:
            data = body.data
            bpy.data.objects.remove(body)
            bpy.data.meshes.remove(data)
        self._placed = []

    def add_jaws(self, jaws: Sequence[Jaws | None], places: Sequence[Array]) -> None:
        """Put jaws in front of the shafts at `places`."""
        while len(self._steels) < len(jaws):
            self._steels.append(SteelMaterial.create(f"jaws {len(self._steels)}"))
        for one, place, steel in zip(jaws, places, self._steels, strict=False):
            if one is not None:
                mesh = jaws_mesh(one.width_mm, one.length_mm, one.opening_deg)
                steel.apply(one.steel)
                turned = place @ _turned_about_z(one.roll_deg)
                self._add("jaws", mesh, turned, steel.material, TOOL_INDEX)

    def add_lumps(self, occluders: Sequence[Occluder], background: Any) -> None:
        """Add lumps of tissue in the colours of a Blender image."""
        while len(self._tissues) < len(occluders):
            self._tissues.append(TissueMaterial.create(f"tissue {len(self._tissues)}"))
        for occluder, tissue in zip(occluders, self._tissues, strict=False):
            mesh = lump_mesh(occluder.radii_mm, occluder.shape_seed)
            tissue.apply(background, occluder.tint)
            self._add("lump", mesh, _occluder_matrix(occluder), tissue.material, 0)

    def meshes(self) -> Iterator[tuple[Mesh, Array]]:
        """Each placed mesh, and the matrix (4, 4) from its frame to the camera's."""
        return ((mesh, _FLIP @ np.array(body.matrix_world)) for body, mesh in self._placed)

    def _add(self, name: str, mesh: Mesh, place: Array, material: Any, index: int) -> None:
        body = bpy.data.objects.new(name, blender_mesh(name, mesh, smooth=True))
        body.data.materials[0] = material
        body.pass_index = index
        body.matrix_world = _to_blender(_FLIP @ place)
        self._scene.collection.objects.link(body)
        self._placed.append((body, mesh))


def blender_mesh(name: str, mesh: Mesh, smooth: bool) -> Any:
    """A mesh of the open file, with one empty slot for a material."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(mesh.vertices.tolist(), [], mesh.faces)
    layer = data.uv_layers.new()
    layer.data.foreach_set("uv", mesh.uv.astype(np.float32).ravel())
    if smooth:
        _smooth_sides(data)
    data.materials.append(None)
    return data


def _smooth_sides(data: Any) -> None:
    """Shade faces smooth, except those with more than four corners: a shaft's flat ends."""
    flags = [len(face.vertices) <= 4 for face in data.polygons]
    data.polygons.foreach_set("use_smooth", flags)
    data.set_sharp_from_angle(angle=np.radians(30))


def _pose_matrix(pose: ShaftPose, roll_deg: float) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rolled(roll_deg), pose.tip_mm
    return matrix


def _occluder_matrix(occluder: Occluder) -> NDArray[np.float64]:
    matrix = _turned_about_z(occluder.turn_deg)
    matrix[:3, 3] = occluder.centre_mm
    return matrix


def _turned_about_z(angle_deg: float) -> NDArray[np.float64]:
    turn, matrix = np.radians(angle_deg), np.eye(4)
    matrix[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    return matrix


def _show(shaft: Any, shown: bool) -> None:
    """Show a shaft to all rays, or to none.

    Not `hide_render`: Cycles would keep the material, and its images, of a hidden object.
    """
    for rays in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(shaft, f"visible_{rays}", shown)


def _to_blender(matrix: NDArray[np.float64]) -> list[list[float]]:
    return [[float(value) for value in row] for row in matrix.T]
