"""The rendered squares that frames are cut from; rendered once, and kept in data/whole_frames."""

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from shaftpose.backgrounds.library import write_backgrounds
from shaftpose.core.background_index import INDEX_NAME, read_library
from shaftpose.farm.render_sets import render_sets
from shaftpose.rendering.image_sets import CLEAR, by_path, with_scene
from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.settings.parsing import to_json
from shaftpose.settings.schema import LensSettings, PoseRanges, RenderSettings
from shaftpose.settings.tree import Settings

FOLDER = Path("data/whole_frames")
# Light paths per pixel. The network sees 13 to 41 of these pixels as one, the fit about 2.
SAMPLES = (3, 6)
_SECONDS_PER_MEGAPIXEL = 2.6  # measured on one core of 2 GHz, one to two shafts
_IMAGES_PER_SHARD = 20
_FRAMES_PER_SOURCE, _VARIATIONS = 5, 4  # of the backgrounds

VIEWS_DEG = (40, 55, 63, 75, 85, 100)


@dataclass(frozen=True)
class Squares:
    """A set of rendered squares. share: their number, of the frames that are asked for. scene:
    changed settings of the scene."""

    side_px: int
    view_deg: float
    share: float
    scene: Mapping[str, Any]


_CROSSED = {"occluder_probability": 0.0, "crossing_probability": 1.0}
_OCCLUDED = {"occluder_probability": 1.0, "crossing_probability": 0.0}
SQUARES = {
    "wide": Squares(1911, 95, 1, CLEAR),
    "squares": Squares(1080, 95, 5 / 3, CLEAR),
    "crossed": Squares(1080, 95, 1, _CROSSED),
    "occluded": Squares(1080, 95, 1, _OCCLUDED),
    **{f"view_{deg}": Squares(1080, deg, 1 / len(VIEWS_DEG), CLEAR) for deg in VIEWS_DEG},
}


def render(names: Iterable[str], settings: Settings, frames: int, seed: int) -> None:
    """Render the missing ones of the named sets into subfolders of `FOLDER`."""
    sets = {name: rendered_set(name, settings, frames, seed) for name in names}
    images = sum(one.images for one in sets.values())
    pixels = sum(one.images * SQUARES[name].side_px ** 2 for name, one in sets.items())
    hours = pixels / 1e6 * _SECONDS_PER_MEGAPIXEL / 3600
    print(f"{images} squares; unless some are there, about {hours:.1f} hours of a core", flush=True)
    render_sets(sets, settings.cluster, FOLDER / "scratch", FOLDER)


def rendered_set(name: str, settings: Settings, frames: int, seed: int) -> RenderedSet:
    """A set, with backgrounds of its size, which are written if they are missing."""
    squares = SQUARES[name]
    return RenderedSet(
        settings=enlarged(settings.rendering, squares),
        backgrounds=by_path(read_library(_backgrounds(settings, squares.side_px, frames, seed))),
        seed=seed + list(SQUARES).index(name),
        images=math.ceil(squares.share * frames),
        images_per_shard=_IMAGES_PER_SHARD,
    )


def _backgrounds(settings: Settings, side_px: int, frames: int, seed: int) -> Path:
    sources = math.ceil(frames / _FRAMES_PER_SOURCE)
    about = f"{to_json(settings.backgrounds)} {sources} {side_px} {seed}"
    folder = FOLDER / "backgrounds" / hashlib.sha256(about.encode()).hexdigest()[:16]
    if not (folder / INDEX_NAME).is_file():
        write_backgrounds(settings.backgrounds, sources, _VARIATIONS, side_px, seed, folder)
    return folder


def enlarged(settings: RenderSettings, squares: Squares) -> RenderSettings:
    """The settings for more pixels and another view, whose tips are as near to the border."""
    times = squares.side_px / settings.camera.size_px
    angle = _tangent(squares.view_deg) / _tangent(settings.camera.view_deg)
    changed = with_scene(
        settings,
        {**squares.scene, "min_visible_px": round(times**2 * settings.scene.min_visible_px)},
    )
    return replace(
        changed,
        camera=replace(settings.camera, size_px=squares.side_px, view_deg=squares.view_deg),
        poses=_spread(settings.poses, angle),
        lens=_in_px(settings.lens, times),
        samples=SAMPLES,
    )


def _tangent(view_deg: float) -> float:
    return math.tan(math.radians(view_deg) / 2)


def _spread(poses: PoseRanges, times: float) -> PoseRanges:
    (left, right), (top, bottom) = poses.x_mm, poses.y_mm
    return replace(poses, x_mm=(times * left, times * right), y_mm=(times * top, times * bottom))


def _in_px(lens: LensSettings, times: float) -> LensSettings:
    """The same lens for `times` as many pixels a side."""
    (blur, more_blur), (motion, more_motion) = lens.blur_px, lens.motion_px
    return replace(
        lens,
        blur_px=(times * blur, times * more_blur),
        motion_px=(times * motion, times * more_motion),
        field_px=None if lens.field_px is None else times * lens.field_px,
    )
