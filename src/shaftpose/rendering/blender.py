"""The Blender scene: one per process, updated for each image, rendered by Cycles.

1 Blender unit is 1 mm. Blender's camera looks along -z with y up: points of the project's camera
frame are converted by the flip (x, -y, -z).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import bpy
import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import read_rgb
from shaftpose.core.masks import mask_box
from shaftpose.rendering.coating_picture import coating_picture
from shaftpose.rendering.cycles_passes import PassReader
from shaftpose.rendering.device import use_device
from shaftpose.rendering.films import FilmLayer
from shaftpose.rendering.materials import (
    CoatingLayer,
    GlowMaterial,
    SteelMaterial,
    TissueMaterial,
    mirrored_image,
    surface_image,
)
from shaftpose.rendering.meshes import Mesh, lump_mesh, projected_outline
from shaftpose.rendering.optics import pinhole_behind, seen_by
from shaftpose.rendering.regions import Region, cover
from shaftpose.rendering.scene import Jaws, Light, Occluder, Scene
from shaftpose.rendering.shapes import instrument_shape, jaws_mesh
from shaftpose.settings.schema import RenderSettings, SceneSettings

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
_LEAST_ROOM_MM = 60.0  # half edge of the cube with the background
_LAMP_MM = 2.0  # from the lens to a light guide
_RING_LAMPS = 8
_LAMP_SIZE_MM = 1.5
# Margin of the rendered region: the pixel filter reaches beyond a mesh's edge.
_MARGIN_PX = 3
# Fixed cost of a render, in samples of empty pixels: 0.5 ms in Cycles at 0.2 us per sample, plus a
# reserve for Python's overhead.
_RENDER_PX_SAMPLES = 4_000
# Of occluders and jaws; above any number of shafts; Blender's limit is 32,767.
_UNANNOTATED_INDEX = 30_000
# Metal reflects the cube after one bounce, and the other shaft's reflections after two.
_BOUNCES = 2


@dataclass(frozen=True)
class Foreground:
    """Blender's output for the region of shafts and occluders; the whole image if distorted.

    linear: (h, w, 4) float32, scene-linear RGB premultiplied by alpha; index: (h, w) int, n + 1
    where shaft n is in front at the pixel's centre, 0 elsewhere.
    """

    region: Region
    linear: NDArray[np.float32]
    index: NDArray[np.int64]


class Renderer:
    """Renders scenes. Only one may exist per process, because Blender has one open file.

    Raises InputError if the settings' CAD file or distortion cannot be used.
    """

    def __init__(self, settings: RenderSettings) -> None:
        self._shape = instrument_shape(settings.shaft)
        self._mesh = self._shape.mesh
        self._pinhole = pinhole_behind(settings)
        self._samples = settings.samples
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._scene = bpy.context.scene
        _set_up_cycles(self._scene, self._pinhole.width, settings.samples)
        use_device(self._scene, settings.device)
        _add_camera(self._scene, self._pinhole)
        self._lamps = [_add_lamp(self._scene, *place) for place in lamp_places(settings.scene)]
        self._glow = _add_room(self._scene, room_half_mm(settings, self._pinhole))
        self._data = _blender_mesh("shaft", self._mesh, smooth=True)
        self._shafts: list[Any] = []
        self._places: list[NDArray[np.float64]] = []  # of the shafts in the scene
        self._steels: list[SteelMaterial] = []
        self._coatings: list[CoatingLayer] = []
        self._films: list[FilmLayer] = []
        self._jaw_steels: list[SteelMaterial] = []
        self._jaws: list[tuple[Any, Mesh]] = []
        self._tissues: list[TissueMaterial] = []
        self._occluders: list[tuple[Any, Mesh]] = []
        self._images: list[Any] = []  # of the scene: reflected by metal, shown by tissue, coatings
        self._past_images: list[Any] = []  # of earlier scenes
        self._reader = PassReader()

    def render(self, scene: Scene) -> Foreground | None:
        """Render the shafts and occluders of a scene; None if nothing is in view."""
        self._show_background(scene.background, scene.light)
        self._place_shafts(scene.shafts, scene.rolls_deg)
        for material, steel in zip(self._steels, scene.steels, strict=False):
            material.apply(steel)
        self._coat(scene)
        for layer, film in zip_longest(self._films, scene.films[: len(self._films)]):
            layer.apply(film)
        self._place_jaws(scene.jaws)
        self._place_occluders(scene.occluders)
        return self._render_for(scene.camera)

    def silhouettes(
        self, poses: Sequence[ShaftPose], camera: Camera, rolls_deg: Sequence[float] | None = None
    ) -> NDArray[np.int64]:
        """Index (H, W) of the shaft in front at each pixel's centre of `camera`, n + 1, or 0."""
        self._place_shafts(poses, rolls_deg or [0.0] * len(poses))
        self._place_jaws(())
        self._place_occluders(())
        index = np.zeros((camera.height, camera.width), dtype=np.int64)
        foreground = self._render_for(camera)
        if foreground is not None:
            index[foreground.region.slices] = foreground.index
        return index

    def _show_background(self, path: Path, light: Light) -> None:
        images = [mirrored_image(read_rgb(path)), bpy.data.images.load(str(path.resolve()))]
        self._glow.apply(images[0], light.ambient)
        self._past_images += self._images
        self._images = images
        for lamp in self._lamps:
            lamp.data.energy = light.strength / len(self._lamps)
            lamp.data.color = kelvin_to_rgb(light.kelvin)

    def _place_shafts(self, poses: Sequence[ShaftPose], rolls_deg: Sequence[float]) -> None:
        while len(self._shafts) < len(poses):
            self._add_shaft()
        self._places = [_pose_matrix(*pair) for pair in zip(poses, rolls_deg, strict=True)]
        for number, shaft in enumerate(self._shafts):
            _show(shaft, number < len(poses))
            if number < len(poses):
                shaft.matrix_world = _to_blender(_FLIP @ self._places[number])

    def _add_shaft(self) -> None:
        number = len(self._shafts)
        shaft = bpy.data.objects.new(f"shaft {number}", self._data)
        self._scene.collection.objects.link(shaft)
        steel = SteelMaterial.create(f"steel {number}")
        shaft.material_slots[0].link = "OBJECT"
        shaft.material_slots[0].material = steel.material
        shaft.pass_index = number + 1
        self._shafts.append(shaft)
        self._steels.append(steel)
        self._coatings.append(CoatingLayer(steel.material))
        self._films.append(FilmLayer(steel.material))

    def _coat(self, scene: Scene) -> None:
        """Give the shafts their coatings."""
        size_mm = np.pi * self._shape.diameter_mm, self._shape.length_mm
        pairs = zip(scene.coatings, scene.steels, strict=False)
        for layer, pair in zip_longest(self._coatings, pairs):
            coating, steel = pair or (None, None)
            if coating is None or steel is None:
                layer.apply(None, None, size_mm)
                continue
            picture = coating_picture(coating, steel, self._shape.diameter_mm, size_mm[1])
            self._images.append(surface_image(picture))
            layer.apply(coating, self._images[-1], size_mm)

    def _place_jaws(self, jaws: Sequence[Jaws | None]) -> None:
        """Put jaws in front of the placed shafts."""
        _remove(self._jaws)
        while len(self._jaw_steels) < len(jaws):
            self._jaw_steels.append(SteelMaterial.create(f"jaws {len(self._jaw_steels)}"))
        self._jaws = [
            self._add_jaws(one, place, material)
            for one, place, material in zip(jaws, self._places, self._jaw_steels, strict=False)
            if one is not None
        ]

    def _add_jaws(
        self, jaws: Jaws, place: NDArray[np.float64], material: SteelMaterial
    ) -> tuple[Any, Mesh]:
        mesh = jaws_mesh(jaws.width_mm, jaws.length_mm, jaws.opening_deg)
        both = bpy.data.objects.new("jaws", _blender_mesh("jaws", mesh, smooth=True))
        both.data.materials[0] = material.material
        both.pass_index = _UNANNOTATED_INDEX
        both.matrix_world = _to_blender(_FLIP @ place @ _turned_about_z(jaws.roll_deg))
        material.apply(jaws.steel)
        self._scene.collection.objects.link(both)
        return both, mesh

    def _place_occluders(self, occluders: Sequence[Occluder]) -> None:
        _remove(self._occluders)
        while len(self._tissues) < len(occluders):
            self._tissues.append(TissueMaterial.create(f"tissue {len(self._tissues)}"))
        pairs = zip(occluders, self._tissues, strict=False)
        self._occluders = [self._add_occluder(occluder, tissue) for occluder, tissue in pairs]

    def _add_occluder(self, occluder: Occluder, tissue: TissueMaterial) -> tuple[Any, Mesh]:
        mesh = lump_mesh(occluder.radii_mm, occluder.shape_seed)
        lump = bpy.data.objects.new("lump", _blender_mesh("lump", mesh, smooth=True))
        lump.data.materials[0] = tissue.material
        lump.pass_index = _UNANNOTATED_INDEX
        lump.matrix_world = _to_blender(_FLIP @ _occluder_matrix(occluder))
        tissue.apply(self._images[1], occluder.tint)
        self._scene.collection.objects.link(lump)
        return lump, mesh

    def _render_for(self, camera: Camera) -> Foreground | None:
        """Render the placed scene, as seen by `camera`."""
        foreground = self._render_regions()
        if foreground is None or camera == self._pinhole:
            return foreground
        linear = np.zeros((self._pinhole.height, self._pinhole.width, 4), dtype=np.float32)
        index = np.zeros(linear.shape[:2], dtype=np.int64)
        linear[foreground.region.slices] = foreground.linear
        index[foreground.region.slices] = foreground.index
        whole = Region(0, 0, camera.width, camera.height)
        return Foreground(whole, *seen_by(camera, self._pinhole, linear, index))

    def _render_regions(self) -> Foreground | None:
        """Call Blender for each non-empty part of the image."""
        touched = self._touched()
        if not touched.any():
            return None
        linear = np.zeros((*touched.shape, 4), dtype=np.float32)
        index = np.zeros(touched.shape, dtype=np.int64)
        for region in cover(touched, _RENDER_PX_SAMPLES / self._samples):
            _set_border(self._scene, region, self._pinhole)
            passes = self._reader.render()
            self._remove_past_images()
            linear[region.slices] = passes["Combined"]
            index[region.slices] = np.rint(passes["IndexOB"][..., 0])
        index[index == _UNANNOTATED_INDEX] = 0
        whole = Region(*mask_box(touched))
        return Foreground(whole, linear[whole.slices], index[whole.slices])

    def _remove_past_images(self) -> None:
        """Remove the images of earlier scenes, after a render without them.

        Cycles' persistent data ignores changes to an image, so each scene has new images. Cycles
        knows them by their addresses: until a render without an image, a new one at its address
        would look like it.
        """
        while self._past_images:
            bpy.data.images.remove(self._past_images.pop())

    def _touched(self) -> NDArray[np.bool_]:
        """Mask (H, W) of pixels that a shaft or an occluder may touch, plus a margin."""
        placed = [(self._mesh, place) for place in self._places]
        others = self._occluders + self._jaws
        placed += [(mesh, _FLIP @ np.array(lump.matrix_world)) for lump, mesh in others]
        touched = np.zeros((self._pinhole.height, self._pinhole.width), dtype=np.uint8)
        for mesh, matrix in placed:
            points = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
            outline = projected_outline(self._pinhole, points, mesh.edges)
            if outline is not None:
                cv2.fillConvexPoly(touched, np.floor(outline).astype(np.int32), (1,))
        margin = np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), dtype=np.uint8)
        return np.asarray(cv2.dilate(touched, margin), dtype=bool)


def kelvin_to_rgb(kelvin: float) -> tuple[float, float, float]:
    """Linear RGB of a black body, brightest channel 1.

    Linear interpolation between 3,000 K, 6,500 K and 10,000 K: this covers endoscope lamps, and
    finer differences do not show on metal.
    """
    known = np.array([3000.0, 6500.0, 10000.0])
    red, green, blue = np.array([[1.0, 1.0, 0.62], [0.45, 1.0, 0.75], [0.15, 1.0, 1.0]])
    channels = [float(np.interp(kelvin, known, channel)) for channel in (red, green, blue)]
    return channels[0], channels[1], channels[2]


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


def _remove(placed: Sequence[tuple[Any, Mesh]]) -> None:
    """Remove objects and their meshes from the open file."""
    for one, _ in placed:
        data = one.data
        bpy.data.objects.remove(one)
        bpy.data.meshes.remove(data)


def _to_blender(matrix: NDArray[np.float64]) -> list[list[float]]:
    return [[float(value) for value in row] for row in matrix.T]


def _set_up_cycles(scene: Any, size_px: int, samples: int) -> None:
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = size_px
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True
    scene.render.dither_intensity = 0.0
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.view_settings.view_transform = "Standard"
    scene.view_layers[0].use_pass_object_index = True
    cycles = scene.cycles
    cycles.seed = 0
    cycles.use_light_tree = False  # made for many lights; here the lamps are the only ones
    cycles.samples, cycles.use_adaptive_sampling = samples, False
    cycles.use_denoising = cycles.use_auto_tile = False
    cycles.max_bounces = cycles.glossy_bounces = _BOUNCES
    cycles.diffuse_bounces, cycles.transmission_bounces = 1, 0
    cycles.volume_bounces = cycles.transparent_max_bounces = 0


def _add_camera(scene: Any, pinhole: Camera) -> None:
    data = bpy.data.cameras.new("scope")
    data.sensor_fit = "HORIZONTAL"
    data.angle = 2 * np.arctan(pinhole.width / (2 * pinhole.focal_px))
    data.clip_start, data.clip_end = 0.1, 1000.0
    camera = bpy.data.objects.new("scope", data)
    scene.collection.objects.link(camera)
    scene.camera = camera


def lamp_places(scene: SceneSettings) -> list[tuple[float, float]]:
    """x and y of the light guides around the lens, mm."""
    if scene.light_shape == "twin":
        return [(-_LAMP_MM, 0.0), (_LAMP_MM, 0.0)]
    angles = 2 * np.pi * np.arange(_RING_LAMPS) / _RING_LAMPS
    return [(_LAMP_MM * float(np.cos(a)), _LAMP_MM * float(np.sin(a))) for a in angles]


def _add_lamp(scene: Any, x_mm: float, y_mm: float) -> Any:
    data = bpy.data.lights.new("light guide", "AREA")
    data.shape, data.size = "DISK", _LAMP_SIZE_MM
    lamp = bpy.data.objects.new("light guide", data)
    lamp.location = (x_mm, y_mm, 0.0)
    lamp.visible_camera = False
    scene.collection.objects.link(lamp)
    return lamp


def room_half_mm(settings: RenderSettings, pinhole: Camera) -> float:
    """Half edge of the cube with the background (paper, training dataset). No visible part of a
    shaft may pierce it: visible parts are within the field of view and no farther than the
    farthest tip, or handle if it points away from the camera."""
    away = max(0.0, -float(np.cos(np.radians(settings.poses.pitch_deg[1]))))
    farthest = settings.poses.z_mm[1] + away * instrument_shape(settings.shaft).length_mm
    across = farthest * max(1.0, pinhole.width / (2 * pinhole.focal_px))
    return max(_LEAST_ROOM_MM, 1.2 * across)


def _add_room(scene: Any, half_mm: float) -> GlowMaterial:
    """The cube of background images around camera and shafts, invisible to the camera."""
    glow = GlowMaterial.create("background")
    mesh = _blender_mesh("room", room_mesh(half_mm), smooth=False)
    mesh.materials[0] = glow.material
    room = bpy.data.objects.new("room", mesh)
    room.visible_camera = room.visible_shadow = False
    scene.collection.objects.link(room)
    return glow


def room_mesh(half_mm: float) -> Mesh:
    """A cube around the camera in Blender's axes; each face shows the whole background, the one in
    front of the camera (-z) in the camera's orientation."""
    corners = half_mm * np.array(
        [[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64
    )
    faces = ((0, 1, 3, 2), (5, 4, 6, 7), (4, 0, 2, 6), (1, 5, 7, 3), (4, 5, 1, 0), (2, 3, 7, 6))
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]] * 6, dtype=np.float64)
    return Mesh(corners, faces, uv)


def _blender_mesh(name: str, mesh: Mesh, smooth: bool) -> Any:
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


def _set_border(scene: Any, region: Region, camera: Camera) -> None:
    """Render only `region`; bit-identical to the same pixels of a full frame."""
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    # Blender rounds border fractions down to pixels; a quarter pixel guards against 2.9999.
    render.border_min_x = (region.x0 + 0.25) / camera.width
    render.border_max_x = (region.x1 + 0.25) / camera.width
    render.border_min_y = (camera.height - region.y1 + 0.25) / camera.height
    render.border_max_y = (camera.height - region.y0 + 0.25) / camera.height
