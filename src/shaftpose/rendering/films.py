"""Blood and clear fluid on a shaft: drops and smears on its steel, in Blender's nodes."""

from statistics import NormalDist
from typing import Any

from shaftpose.rendering.scene import Film

# Measured heights of the pattern below on a shaft's surface; quantiles give the share of the
# surface above a height.
_HEIGHTS = NormalDist(0.496, 0.069)
_EDGE = 0.015  # half of the height range over which a film thickens at its rim
_BLOOD = (0.05, 0.002, 0.001, 1.0)
_BLOOD_TINT = (0.5, 0.03, 0.02, 1.0)  # of steel under thin blood
_CLEAR = (1.0, 1.0, 1.0, 1.0)
_RISE_MM = 3.0  # of a drop's surface, per unit of the pattern's height


class FilmLayer:
    """The film on one steel material: a coat of its Principled shader.

    It covers the places where a pattern in the shaft's coordinates, mm, is high. Steel without a
    film keeps its own nodes.
    """

    def __init__(self, material: Any) -> None:
        self._tree = material.node_tree
        self._shader = self._tree.nodes["Principled BSDF"]
        self._bare = self._shader.inputs["Normal"].links[0].from_socket
        self._nodes: list[Any] = []

    def apply(self, film: Film | None) -> None:
        """Replace the film on the current steel; None: clean steel."""
        while self._nodes:
            self._tree.nodes.remove(self._nodes.pop())
        self._link(self._bare, "Normal")
        if film is None:
            return
        height = self._pattern(film)
        level = _HEIGHTS.inv_cdf(1 - min(max(film.coverage, 1e-3), 1 - 1e-3))
        cover = self._above(height, level)
        self._link(cover, "Coat Weight")
        surface = self._bump(height, level)
        self._link(surface, "Normal")  # a drop refracts the steel below it
        self._link(surface, "Coat Normal")
        self._shader.inputs["Coat Roughness"].default_value = 0.05
        self._shader.inputs["Coat Tint"].default_value = _BLOOD_TINT if film.blood else _CLEAR
        if film.blood:
            self._opaque(self._above(height, level + 2 * _EDGE))

    def _opaque(self, thick: Any) -> None:
        """Hide the steel where blood is thick."""
        colour = self._node("ShaderNodeMixRGB")
        bare, metallic = self._shader.inputs["Base Color"], self._shader.inputs["Metallic"]
        if bare.is_linked:  # by a coating
            self._tree.links.new(bare.links[0].from_socket, colour.inputs["Color1"])
        else:
            colour.inputs["Color1"].default_value = bare.default_value
        colour.inputs["Color2"].default_value = _BLOOD
        self._tree.links.new(thick, colour.inputs["Fac"])
        self._link(colour.outputs["Color"], "Base Color")
        covered = self._math("SUBTRACT", 1.0, thick)
        if metallic.is_linked:
            covered = self._math("MULTIPLY", covered, metallic.links[0].from_socket)
        self._link(covered, "Metallic")

    def _pattern(self, film: Film) -> Any:
        """Height pattern of smears along the shaft and of drops."""
        coordinates = self._node("ShaderNodeTexCoord").outputs["Object"]
        smears = self._noise(coordinates, film, (0.5, 0.5, 0.12), detail=3.0)
        drops = self._noise(coordinates, film, (0.9, 0.9, 0.9), detail=0.0)
        return self._math("ADD", self._math("MULTIPLY", smears, 0.6),
                          self._math("MULTIPLY", drops, 0.4))  # fmt: skip

    def _noise(self, coordinates: Any, film: Film, per_mm: Any, detail: float) -> Any:
        mapping, noise = self._node("ShaderNodeMapping"), self._node("ShaderNodeTexNoise")
        mapping.inputs["Location"].default_value = film.pattern_mm
        mapping.inputs["Scale"].default_value = per_mm
        noise.inputs["Scale"].default_value = 1.0
        noise.inputs["Detail"].default_value = detail
        self._tree.links.new(coordinates, mapping.inputs["Vector"])
        self._tree.links.new(mapping.outputs["Vector"], noise.inputs["Vector"])
        return noise.outputs["Fac"]

    def _above(self, height: Any, level: float) -> Any:
        """Smooth step from 0 below a height level to 1 above it."""
        step = self._node("ShaderNodeMapRange")
        step.interpolation_type = "SMOOTHSTEP"
        step.inputs["From Min"].default_value = level - _EDGE
        step.inputs["From Max"].default_value = level + _EDGE
        self._tree.links.new(height, step.inputs["Value"])
        return step.outputs["Result"]

    def _bump(self, height: Any, level: float) -> Any:
        bump = self._node("ShaderNodeBump")
        bump.inputs["Distance"].default_value = _RISE_MM
        self._tree.links.new(self._math("MAXIMUM", height, level), bump.inputs["Height"])
        self._tree.links.new(self._bare, bump.inputs["Normal"])
        return bump.outputs["Normal"]

    def _math(self, operation: str, *values: Any) -> Any:
        node = self._node("ShaderNodeMath")
        node.operation = operation
        for place, value in zip(node.inputs, values, strict=False):
            if isinstance(value, float):
                place.default_value = value
            else:
                self._tree.links.new(value, place)
        return node.outputs[0]

    def _node(self, kind: str) -> Any:
        node = self._tree.nodes.new(kind)
        self._nodes.append(node)
        return node

    def _link(self, value: Any, name: str) -> None:
        self._tree.links.new(value, self._shader.inputs[name])
