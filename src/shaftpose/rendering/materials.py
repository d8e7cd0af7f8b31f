"""Blender materials: brushed steel, tissue and the glowing background, and their images."""

from dataclasses import dataclass
from typing import Any

import bpy
import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.rendering.compositing import to_linear
from shaftpose.rendering.scene import Steel

_NORMAL_MAP_PX = 512
# Share of the scratches' slopes in the normal map; the rest of their variance is roughness.
_SHOWN_SLOPES = 0.5
_SLOPE = 0.27  # root mean square of the normal map's slopes
_MIRRORED_PX = 24


@dataclass
class SteelMaterial:
    """A physically based metal whose normal map makes it rough (paper, training dataset)."""

    material: Any
    _shader: Any
    _normal_map: Any
    _mapping: Any

    @classmethod
    def create(cls, name: str) -> "SteelMaterial":
        """A new material of that name in the open file."""
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        tree = material.node_tree
        shader = tree.nodes["Principled BSDF"]
        shader.inputs["Metallic"].default_value = 1.0
        coordinates = tree.nodes.new("ShaderNodeUVMap")
        mapping = tree.nodes.new("ShaderNodeMapping")
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image = _normal_map_image()
        normal_map = tree.nodes.new("ShaderNodeNormalMap")
        tree.links.new(coordinates.outputs["UV"], mapping.inputs["Vector"])
        tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
        tree.links.new(texture.outputs["Color"], normal_map.inputs["Color"])
        tree.links.new(normal_map.outputs["Normal"], shader.inputs["Normal"])
        return cls(material, shader, normal_map, mapping)

    def apply(self, steel: Steel) -> None:
        """Set the steel of one shaft. UV are in mm, so the grain is scaled to texture tiles: marks
        around the shaft are a few tenths of a millimetre wide, at least a pixel on near shafts."""
        grey = (steel.grey, steel.grey, steel.grey * 0.98, 1.0)
        self._shader.inputs["Base Color"].default_value = grey
        self._shader.inputs["Roughness"].default_value = roughness_with_scratches(steel)
        # Around the axis: Cycles' default tangent is about the object's z.
        self._shader.inputs["Anisotropic"].default_value = steel.anisotropy
        self._normal_map.inputs["Strength"].default_value = _SHOWN_SLOPES * steel.scratches
        self._mapping.inputs["Scale"].default_value = (0.025, steel.grain / 400, 1.0)


def roughness_with_scratches(steel: Steel) -> float:
    """Roughness of steel with its finest scratches (Blender's: its square is the GGX alpha).

    Scratches finer than a pixel look like roughness, but cost many samples as a normal map. Their
    slope variance s^2 adds 2 s^2 to alpha^2 (Olano and Baker, LEAN Mapping, 2010).
    """
    variance = (1 - _SHOWN_SLOPES**2) * (_SLOPE * steel.scratches) ** 2
    return float(min(steel.roughness**4 + 2 * variance, 1.0) ** 0.25)


def _normal_map_image() -> Any:
    """The normal map as a Blender image, shared by all steels of a file."""
    existing = bpy.data.images.get("scratches")
    if existing is not None:
        return existing
    image = bpy.data.images.new(
        "scratches", _NORMAL_MAP_PX, _NORMAL_MAP_PX, alpha=False, float_buffer=True, is_data=True
    )
    pixels = np.ones((_NORMAL_MAP_PX, _NORMAL_MAP_PX, 4), dtype=np.float32)
    pixels[..., :3] = scratch_normals(np.random.default_rng(0), _NORMAL_MAP_PX)
    image.pixels.foreach_set(pixels.ravel())
    return image


def scratch_normals(rng: np.random.Generator, size_px: int) -> NDArray[np.float32]:
    """Tileable tangent-space normal map (size, size, 3) in [0, 1]: turning marks around the shaft,
    fine grain, and a few scratches along it."""
    grain = rng.normal(size=(size_px, size_px)).astype(np.float32)
    wrap = cv2.BORDER_WRAP
    turned = _blur_tiled(grain, 24, 0.7)
    along = _blur_tiled(rng.normal(size=grain.shape).astype(np.float32), 0.7, 24)
    fine = _blur_tiled(rng.normal(size=grain.shape).astype(np.float32), 1.0, 1.0)
    height = turned / turned.std() + 0.5 * along / along.std() + 0.3 * fine / fine.std()
    height = cv2.copyMakeBorder(height, 1, 1, 1, 1, wrap)
    slope_u = (height[1:-1, 2:] - height[1:-1, :-2]) / 2
    slope_v = (height[2:, 1:-1] - height[:-2, 1:-1]) / 2
    normal = np.stack([-slope_u, -slope_v, np.full_like(slope_u, 2.0)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return (normal * 0.5 + 0.5).astype(np.float32)


def _blur_tiled(image: NDArray[np.float32], sigma_u: float, sigma_v: float) -> NDArray[np.float32]:
    """Gaussian blur that wraps around, so the result is tileable."""
    pad = int(4 * max(sigma_u, sigma_v))
    padded = cv2.copyMakeBorder(image, pad, pad, pad, pad, cv2.BORDER_WRAP)
    blurred = cv2.GaussianBlur(padded, (0, 0), sigmaX=sigma_u, sigmaY=sigma_v)
    return np.asarray(blurred[pad:-pad, pad:-pad], dtype=np.float32)


class SceneImages:
    """Blender's images of the current scene.

    Cycles' persistent data ignores changes to an image, so each scene has new images. Cycles knows
    them by their addresses: a new image at the address of one that was rendered last looks like
    that one. An image may therefore be removed only after a render without it.
    """

    def __init__(self) -> None:
        self._current: list[Any] = []
        self._past: list[Any] = []

    def begin_scene(self) -> None:
        """Treat all images added so far as those of earlier scenes."""
        self._past += self._current
        self._current = []

    def add(self, image: Any) -> Any:
        """Take a new image into the current scene; returns it."""
        self._current.append(image)
        return image

    def remove_past(self) -> None:
        """Remove the images of earlier scenes; to be called after a render of the current one."""
        while self._past:
            bpy.data.images.remove(self._past.pop())


def mirrored_image(rgb: NDArray[np.uint8]) -> Any:
    """A background (H, W, 3) as a new Blender image, in linear light at low resolution.

    A pixel of rough steel reflects a wide angle of the background, so detail would only add noise.
    """
    size = (_MIRRORED_PX, _MIRRORED_PX)
    image = bpy.data.images.new("mirrored", *size, alpha=False, float_buffer=True)
    pixels = np.ones((*size, 4), dtype=np.float32)
    # Blender's images start with the bottom row.
    pixels[::-1, :, :3] = cv2.resize(to_linear(rgb), size, interpolation=cv2.INTER_AREA)
    image.pixels.foreach_set(pixels.ravel())
    return image


def surface_image(picture: NDArray[np.float32]) -> Any:
    """A picture (rows, columns, 4) as a new Blender image: linear, alpha apart from the colours."""
    rows, columns = picture.shape[:2]
    image = bpy.data.images.new("coating", columns, rows, alpha=True, float_buffer=True)
    image.alpha_mode = "CHANNEL_PACKED"
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(picture.ravel())  # Blender's first row is at v = 0, as the picture's
    return image


@dataclass
class GlowMaterial:
    """Emits an image, independent of lighting."""

    material: Any
    _texture: Any
    _emission: Any

    @classmethod
    def create(cls, name: str) -> "GlowMaterial":
        """A new material of that name in the open file."""
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.extension = "EXTEND"
        # Reflection rays find the background; sampling it as a lamp would cost time.
        material.cycles.emission_sampling = "NONE"
        emission = tree.nodes.new("ShaderNodeEmission")
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(texture.outputs["Color"], emission.inputs["Color"])
        tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
        return cls(material, texture, emission)

    def apply(self, image: Any, strength: float) -> None:
        """Show a Blender image at `strength` times its own brightness."""
        self._texture.image = image
        self._emission.inputs["Strength"].default_value = strength


@dataclass
class TissueMaterial:
    """Wet tissue in the background's colours, for lumps that hide a shaft."""

    material: Any
    _texture: Any
    _tint: Any
    _glow: Any

    @classmethod
    def create(cls, name: str) -> "TissueMaterial":
        """A new material of that name in the open file."""
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        tree = material.node_tree
        shader = tree.nodes["Principled BSDF"]
        shader.inputs["Roughness"].default_value = 0.35
        # Not a lamp: without a light tree, Cycles' persistent data would keep the lamps of removed
        # lumps, and an image would depend on earlier ones.
        material.cycles.emission_sampling = "NONE"
        texture = tree.nodes.new("ShaderNodeTexImage")
        tint = tree.nodes.new("ShaderNodeHueSaturation")
        tree.links.new(texture.outputs["Color"], tint.inputs["Color"])
        # The scope's light is set for steel; tissue this near would be overexposed.
        dark = tree.nodes.new("ShaderNodeHueSaturation")
        dark.inputs["Value"].default_value = 0.1
        tree.links.new(tint.outputs["Color"], dark.inputs["Color"])
        tree.links.new(dark.outputs["Color"], shader.inputs["Base Color"])
        tree.links.new(tint.outputs["Color"], shader.inputs["Emission Color"])
        return cls(material, texture, tint, shader.inputs["Emission Strength"])

    def apply(self, image: Any, tint: float) -> None:
        """Set the colours of a Blender image, `tint` times as bright. The tissue glows a little,
        like the background; otherwise lumps far from the light would be black."""
        self._texture.image = image
        self._tint.inputs["Value"].default_value = tint
        self._glow.default_value = 0.6
