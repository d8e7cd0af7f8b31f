"""Polymer coatings of shafts: a picture of coating, bare metal at the tip, rings and print, and the
layer in Blender's nodes that shows it."""

import string
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.random_streams import streams
from shaftpose.rendering.scene import Coating, Steel

_COATING_ROWS = 1000  # of the picture of a 200 mm shaft
_PX_PER_MM = 5.0
_MOST_RINGS = 3
_MARKED_MM = 50.0  # rings and print are within this distance from the tip
_PRINTED_SHARE = 0.5  # of the coated shafts


def coating_picture(
    coating: Coating, steel: Steel, diameter_mm: float, length_mm: float
) -> NDArray[np.float32]:
    """Picture of a coated shaft, (rows along it from the tip, columns around it, 4): linear RGB
    reflectance, and the share of bare metal."""
    rows, columns = (max(8, round(size * _PX_PER_MM)) for size in (length_mm, np.pi * diameter_mm))
    base = np.array(coating.rgb, dtype=np.float32)
    picture = np.zeros((rows, columns, 4), dtype=np.float32)
    picture[..., :3] = base
    stream = streams(coating.marks_seed)
    _add_rings(stream("rings"), picture, base)
    _add_print(stream("print"), picture, base)
    bare = _row(coating.bare_mm)
    picture[:bare] = steel.grey, steel.grey, steel.grey, 1.0
    return picture


def _row(mm: float) -> int:
    return round(float(mm) * _PX_PER_MM)


def _add_rings(
    rng: np.random.Generator, picture: NDArray[np.float32], base: NDArray[np.float32]
) -> None:
    for _ in range(int(rng.integers(_MOST_RINGS + 1))):
        start = _row(rng.uniform(0, _MARKED_MM))
        end = start + _row(rng.uniform(0.2, 2.5)) + 1
        picture[start:end, :, :3] = _contrast(rng, base)


def _add_print(
    rng: np.random.Generator, picture: NDArray[np.float32], base: NDArray[np.float32]
) -> None:
    if rng.random() < _PRINTED_SHARE:
        mark = _print_mask(rng, *picture.shape[:2])[..., None]
        picture[..., :3] += mark * (_contrast(rng, base) - picture[..., :3])


def _contrast(rng: np.random.Generator, base: NDArray[np.float32]) -> NDArray[np.float32]:
    """A lighter colour on dark coatings, a darker one on light ones."""
    factor = rng.uniform(2, 8) if base.mean() < 0.06 else rng.uniform(0.05, 0.6)
    return np.clip(base * np.float32(factor), 0, 1)


def _print_mask(rng: np.random.Generator, rows: int, columns: int) -> NDArray[np.float32]:
    """Coverage (rows, columns) of a word in block letters along the shaft."""
    word = "".join(rng.choice(list(string.ascii_uppercase + string.digits), rng.integers(2, 10)))
    height = columns * float(rng.uniform(0.12, 0.3))  # of letters, around the shaft
    scale = height / 21  # OpenCV's plain capitals are 21 px high at scale 1
    along = np.zeros((columns, rows), dtype=np.uint8)
    weight = max(1, round(height / 6))
    start = min(_row(rng.uniform(2, _MARKED_MM)), rows - 1)  # of a short shaft
    top = int(rng.integers(columns - int(height)))
    (width, _), _ = cv2.getTextSize(word, cv2.FONT_HERSHEY_SIMPLEX, scale, weight)
    strip = along[top : top + int(height) + 2 * weight, start : start + width]
    base = 0, int(height) + weight
    cv2.putText(strip, word, base, cv2.FONT_HERSHEY_SIMPLEX, scale, (255,), weight, cv2.LINE_AA)
    if rng.random() < 0.5:  # read from the handle
        strip[:] = strip[::-1, ::-1].copy()
    return along.T.astype(np.float32) / 255


class CoatingLayer:
    """The polymer coating on one steel material: colour, share of metal and roughness by a picture.
    Steel without a coating keeps its own nodes."""

    def __init__(self, material: Any) -> None:
        tree = material.node_tree
        self._links, self._shader = tree.links, tree.nodes["Principled BSDF"]
        coordinates = tree.nodes.new("ShaderNodeUVMap")
        self._mapping = tree.nodes.new("ShaderNodeMapping")
        self._texture = tree.nodes.new("ShaderNodeTexImage")
        self._roughness = tree.nodes.new("ShaderNodeMapRange")
        tree.links.new(coordinates.outputs["UV"], self._mapping.inputs["Vector"])
        # Along the shaft, the tip's disc has coordinates below 0. It gets the picture's first row.
        from_tip = tree.nodes.new("ShaderNodeVectorMath")
        from_tip.operation = "MAXIMUM"
        from_tip.inputs[1].default_value = (-1e6, 0.5 / _COATING_ROWS, -1e6)
        tree.links.new(self._mapping.outputs["Vector"], from_tip.inputs[0])
        tree.links.new(from_tip.outputs["Vector"], self._texture.inputs["Vector"])
        tree.links.new(self._texture.outputs["Alpha"], self._roughness.inputs["Value"])

    def apply(self, coating: Coating | None, picture: Any, size_mm: tuple[float, float]) -> None:
        """Replace the coating on the current steel; None: bare steel.

        picture: Blender image of `coating_picture`; size_mm: its extent around and along.
        """
        for name in ("Base Color", "Metallic", "Roughness"):
            for link in list(self._shader.inputs[name].links):
                self._links.remove(link)
        if coating is None:
            return
        self._texture.image = picture
        self._mapping.inputs["Scale"].default_value = (1 / size_mm[0], 1 / size_mm[1], 1.0)
        # 0 on the polymer, 1 on bare metal.
        self._roughness.inputs["To Min"].default_value = coating.roughness
        self._roughness.inputs["To Max"].default_value = self._shader.inputs[
            "Roughness"
        ].default_value
        self._links.new(self._texture.outputs["Color"], self._shader.inputs["Base Color"])
        self._links.new(self._texture.outputs["Alpha"], self._shader.inputs["Metallic"])
        self._links.new(self._roughness.outputs["Result"], self._shader.inputs["Roughness"])
