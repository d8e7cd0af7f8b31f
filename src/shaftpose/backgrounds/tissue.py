"""Procedural endoscopic tissue: endoscope images without instruments.

A relief of walls, funnels and folds (`relief`) is covered with tissue (`skin`), and lit and seen by
the endoscope (`scope`). Colours are linear RGB before the camera.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.backgrounds.noise import Range, blurred
from shaftpose.backgrounds.relief import SURFACES, Relief, make_relief
from shaftpose.backgrounds.scope import add_highlights, develop, expose, scope_light, smoke
from shaftpose.backgrounds.skin import Skin, SkinLook, fill_hollows, make_skin, palette
from shaftpose.core.random_streams import Streams


@dataclass(frozen=True)
class TissueLook:
    """Parameters of one kind of tissue. Ranges are sampled once per image.

    folds: number of folds; fold_radius: their half width in image sides; funnel_chance,
    fluid_chance: probability of a funnel, and of blood or mucus in the hollows; wet_share: share
    of highlights in the image, log-uniform; brightness: mean of the finished image, 0 to 1.
    """

    skin: SkinLook
    folds: tuple[int, int]
    fold_radius: Range
    funnel_chance: float
    fluid_chance: float
    wet_share: Range
    brightness: Range


MUCOSA = TissueLook(
    SkinLook(
        tones=((226, 128, 112), (208, 92, 78), (234, 158, 138), (176, 60, 58), (226, 126, 84),
               (204, 118, 124), (228, 176, 166), (234, 138, 92), (200, 124, 138), (178, 92, 100),
               (232, 112, 66), (150, 46, 50), (216, 170, 176), (236, 126, 82), (222, 96, 74),
               (212, 106, 102)),
        fat=(236, 158, 84),
        fat_chance=0.17,
        vessel_roots=(1, 24),
        vessel_width=(0.002, 0.009),
    ),
    folds=(0, 5),
    fold_radius=(0.12, 0.42),
    funnel_chance=0.45,
    fluid_chance=0.3,
    wet_share=(0.0001, 0.006),
    brightness=(0.36, 0.56),
)  # fmt: skip

STAND_IN = TissueLook(
    SkinLook(
        tones=((242, 180, 132), (240, 158, 98), (244, 198, 160), (234, 142, 92), (240, 172, 114)),
        fat=(238, 168, 84),
        fat_chance=0.7,
        vessel_roots=(5, 13),
        vessel_width=(0.005, 0.013),
    ),
    folds=(1, 3),
    fold_radius=(0.3, 0.7),
    funnel_chance=0.2,
    fluid_chance=0.3,
    wet_share=(0.0001, 0.006),
    brightness=(0.45, 0.62),
)


def render_tissue(stream: Streams, size_px: int, look: TissueLook = MUCOSA) -> NDArray[np.uint8]:
    """One (size, size, 3) RGB image of tissue."""
    # Filters lack neighbours at the border, so a rim is rendered and cropped.
    rim_px = int(np.ceil(0.02 * size_px))
    relief = draw_relief(stream, size_px + 2 * rim_px, look)
    skin = covering(stream, relief, look.skin)
    if stream("whether wet").random() < look.fluid_chance:
        skin = fill_hollows(stream("fluid"), skin, relief.height)
    wet_share = np.exp(stream("highlights").uniform(*np.log(look.wet_share)))
    light, shine = scope_light(stream("light"), relief.height + skin.bumps, wet_share)
    lit = expose(skin.colour * light, stream("brightness").uniform(*look.brightness))
    seen = add_highlights(smoke(stream("smoke"), lit), shine)
    picture = develop(stream("camera"), seen, relief.height)
    return np.ascontiguousarray(picture[rim_px:-rim_px, rim_px:-rim_px])


def draw_relief(stream: Streams, size_px: int, look: TissueLook) -> Relief:
    """Folds, and with its probability a funnel."""
    folds = int(stream("number of folds").integers(look.folds[0], look.folds[1] + 1))
    opened = bool(stream("whether opened").random() < look.funnel_chance)
    return make_relief(stream("relief"), size_px, folds, look.fold_radius, opened)


def covering(stream: Streams, relief: Relief, look: SkinLook) -> Skin:
    """The skin of all pieces of tissue, placed by the relief's labels."""
    size_px = relief.height.shape[0]
    tones = palette(stream("palette"), look)
    colour = np.zeros((size_px, size_px, 3), dtype=np.float32)
    bumps = np.zeros((size_px, size_px), dtype=np.float32)
    for number in range(SURFACES):
        shown = (relief.surface == number).astype(np.float32)
        if shown.any():
            # Blurred, because tissues merge where no step in height separates them.
            shown = blurred(shown, 0.006)
            piece = make_skin(stream(f"skin {number}"), size_px, tones, look)
            colour += shown[..., None] * piece.colour
            bumps += shown * piece.bumps
    return Skin(colour, bumps)
