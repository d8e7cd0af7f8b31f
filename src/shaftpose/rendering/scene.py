"""What one image shows, described apart from the renderer; sampled from one generator.

Image k of a dataset is drawn from `SeedSequence([dataset_seed, k])` and from nothing else.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from shaftpose.config import LensSettings, Range, RenderSettings, SceneSettings, ShaftSettings
from shaftpose.geometry import Camera, ShaftPose
from shaftpose.rendering.poses import PoseSampler


@dataclass(frozen=True)
class Steel:
    """The metal of one shaft; grey is its base reflectance, scratches the normal map's strength."""

    grey: float
    roughness: float
    scratches: float
    grain: float  # how densely the scratches lie along the shaft


@dataclass(frozen=True)
class Light:
    """The scope's light: radiant power in W and colour temperature in K; ambient is the
    brightness of the surroundings as the metal sees them (1 = as photographed)."""

    strength: float
    kelvin: float
    ambient: float


@dataclass(frozen=True)
class Occluder:
    """A lump of tissue between the camera and a shaft: an ellipsoid with an uneven surface."""

    centre_mm: tuple[float, float, float]
    radii_mm: tuple[float, float, float]
    turn_deg: float
    tint: float  # brightness of its surface, 1 is the background's
    shape_seed: int


@dataclass(frozen=True)
class Lens:
    """What lens, air and sensor do to the finished image; see `LensSettings`."""

    blur_px: float
    haze: float
    vignette: float
    noise: float


@dataclass(frozen=True)
class Scene:
    """One image."""

    background: Path
    shafts: tuple[ShaftPose, ...]
    steels: tuple[Steel, ...]
    light: Light
    occluders: tuple[Occluder, ...]
    lens: Lens
    sensor_seed: int
    tries: int

    def facts(self) -> dict[str, Any]:
        """All but poses and background as plain values, for shaft.json."""
        return {
            "light": asdict(self.light),
            "steels": [asdict(steel) for steel in self.steels],
            "occluders": [asdict(occluder) for occluder in self.occluders],
            "lens": asdict(self.lens),
            "tries": self.tries,
        }


@dataclass(frozen=True)
class SceneSampler:
    """Draws scenes; image `index` depends on `(seed, index)` alone."""

    settings: RenderSettings
    backgrounds: Sequence[Path]
    seed: int

    def candidates(self, index: int) -> Iterator[Scene]:
        """Successive draws for image `index`, for whoever must refuse some of them."""
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, index]))
        while True:
            yield self._draw(rng)

    def _draw(self, rng: np.random.Generator) -> Scene:
        settings = self.settings
        camera = settings.camera
        view = Camera.from_field_of_view(camera.size_px, camera.size_px, camera.view_deg)
        background = self.backgrounds[int(rng.integers(len(self.backgrounds)))]
        sampled = PoseSampler(view, settings.poses, settings.shaft, settings.scene)(rng)
        return Scene(
            background=background,
            shafts=sampled.poses,
            steels=tuple(sample_steel(rng, settings.scene) for _ in sampled.poses),
            light=sample_light(rng, settings.scene),
            occluders=sample_occluders(rng, sampled.poses, settings.scene, settings.shaft),
            lens=sample_lens(rng, settings.lens),
            sensor_seed=int(rng.integers(2**31)),
            tries=sampled.tries,
        )


def sample_steel(rng: np.random.Generator, scene: SceneSettings) -> Steel:
    """Steel within the settings' ranges."""
    return Steel(
        grey=_uniform(rng, scene.steel_grey),
        roughness=_uniform(rng, scene.roughness),
        scratches=_uniform(rng, scene.scratches),
        grain=float(rng.uniform(2.0, 8.0)),
    )


def sample_light(rng: np.random.Generator, scene: SceneSettings) -> Light:
    """Light within the settings' ranges."""
    return Light(
        strength=_uniform(rng, scene.light_strength),
        kelvin=_uniform(rng, scene.light_kelvin),
        ambient=_uniform(rng, scene.ambient),
    )


def sample_lens(rng: np.random.Generator, lens: LensSettings) -> Lens:
    """Effects of lens, air and sensor within the settings' ranges."""
    return Lens(
        blur_px=_uniform(rng, lens.blur_px),
        haze=_uniform(rng, lens.haze),
        vignette=_uniform(rng, lens.vignette),
        noise=_uniform(rng, lens.noise),
    )


def sample_occluders(
    rng: np.random.Generator,
    poses: Sequence[ShaftPose],
    scene: SceneSettings,
    shaft: ShaftSettings,
) -> tuple[Occluder, ...]:
    """With the settings' probability one lump of tissue before each shaft, else none."""
    if rng.random() >= scene.occluder_probability:
        return ()
    return tuple(_occluder_before(rng, pose, shaft) for pose in poses)


def _occluder_before(rng: np.random.Generator, pose: ShaftPose, shaft: ShaftSettings) -> Occluder:
    """A lump on the line of sight to a point within 15 mm of the tip."""
    hidden = pose.tip_mm + float(rng.uniform(-1, 15)) * pose.direction
    hidden[2] = max(hidden[2], 4.0)
    # 55..75 % of the way to the shaft: before it, but for a few large lumps that reach it.
    share = float(rng.uniform(0.55, 0.75))
    centre = share * hidden
    room = np.linalg.norm(hidden - centre) - shaft.diameter_mm / 2
    radius = float(np.clip(0.45 * room, 0.8, 4.0))
    radii = radius * rng.uniform([0.8, 0.8, 0.6], [2.0, 1.2, 1.0])
    return Occluder(
        centre_mm=(float(centre[0]), float(centre[1]), float(centre[2])),
        radii_mm=(float(radii[0]), float(radii[1]), float(radii[2])),
        turn_deg=float(rng.uniform(0, 180)),
        tint=float(rng.uniform(0.7, 1.2)),
        shape_seed=int(rng.integers(2**31)),
    )


def _uniform(rng: np.random.Generator, ends: Range) -> float:
    return float(rng.uniform(*ends))
