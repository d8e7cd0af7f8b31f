"""The scene of one image, independent of the renderer, and its sampling.

Image k of a dataset is drawn only from `SeedSequence([dataset_seed, k])`. Options beyond the
paper's setting use spawned children of that sequence, so they leave the rest of the image
unchanged.
"""

from collections.abc import Iterator, Sequence
from dataclasses import MISSING, asdict, dataclass, fields, replace
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.errors import InputError
from shaftpose.rendering.optics import camera_with
from shaftpose.rendering.poses import PoseSampler, SampledPoses
from shaftpose.rendering.shapes import instrument_shape, surrounding_rod
from shaftpose.settings.parts import LensSettings, Range, RenderSettings, SceneSettings

_MOST_REDRAWS = 100
# As estimated in laparoscopic images, where a coated shaft mostly ends with its coating: the share
# of coated shafts with a bare steel end, and, in diameters of the shaft, the longest such end, the
# jaws' widths and their lengths.
_BARE_TIPS, _LONGEST_BARE = 0.2, 1.0
_JAW_WIDTHS, _JAW_LENGTHS = (0.4, 1.0), (0.8, 4.0)
_JAW_OPENINGS_DEG = 0.0, 70.0
# Closed jaws as wide as the shaft would look like a part of it: wider ones are opened by this.
_WIDE_JAWS, _LEAST_OPENING_DEG = 0.8, 15.0


@dataclass(frozen=True)
class Steel:
    """The metal of one shaft; grey is its base reflectance, scratches the normal map's strength."""

    grey: float
    roughness: float
    scratches: float
    grain: float  # density of the scratches along the shaft
    anisotropy: float = 0.0


@dataclass(frozen=True)
class Coating:
    """Polymer on one shaft, with bare steel on `bare_mm` from the tip, rings and print.

    rgb: its linear reflectance."""

    rgb: tuple[float, float, float]
    roughness: float
    bare_mm: float
    marks_seed: int


@dataclass(frozen=True)
class Jaws:
    """Steel jaws in front of a shaft's tip, which are no part of the annotated shaft."""

    opening_deg: float
    width_mm: float
    length_mm: float
    roll_deg: float
    steel: Steel


@dataclass(frozen=True)
class Film:
    """Blood or clear fluid on a share `coverage` of one shaft's surface."""

    blood: bool
    coverage: float
    pattern_mm: tuple[float, float, float]  # offset of the shaft in the pattern of drops


@dataclass(frozen=True)
class Light:
    """The scope's light: radiant power in W, colour temperature in K, and `ambient`, the
    brightness of the surroundings reflected by metal (1 = as photographed)."""

    strength: float
    kelvin: float
    ambient: float


@dataclass(frozen=True)
class Occluder:
    """A lump of tissue between the camera and a shaft: an ellipsoid with an uneven surface."""

    centre_mm: tuple[float, float, float]
    radii_mm: tuple[float, float, float]
    turn_deg: float
    tint: float  # brightness of its surface relative to the background
    shape_seed: int


@dataclass(frozen=True)
class Lens:
    """Effects of lens, air and sensor on the finished image; see `LensSettings`."""

    blur_px: float
    haze: float
    vignette: float
    noise: float
    motion_px: tuple[float, float] = (0.0, 0.0)  # right and down
    jpeg_quality: int | None = None


@dataclass(frozen=True)
class Scene:
    """One image. rolls_deg: rolls of the shafts about their axes, where visible; tries: number of
    shafts that the pose sampler drew, without crossing ones."""

    background: Path
    camera: Camera
    shafts: tuple[ShaftPose, ...]
    rolls_deg: tuple[float, ...]
    steels: tuple[Steel, ...]
    light: Light
    occluders: tuple[Occluder, ...]
    lens: Lens
    sensor_seed: int
    tries: int
    films: tuple[Film, ...] = ()  # one per shaft, or none at all
    coatings: tuple[Coating | None, ...] = ()  # one per shaft, or none at all
    jaws: tuple[Jaws | None, ...] = ()  # one per shaft, or none at all
    contact_shadow: float = 0.0
    crossing: int = 0  # number of shafts, the last ones, sampled to cross in front of another

    def facts(self) -> dict[str, Any]:
        """Everything except poses, background and camera as plain values, for shaft.json; options
        that are off are omitted."""
        facts: dict[str, Any] = {
            "light": _stated(self.light),
            "steels": [_stated(steel) for steel in self.steels],
            "occluders": [_stated(occluder) for occluder in self.occluders],
            "lens": _stated(self.lens),
            "tries": self.tries,
        }
        options: dict[str, Any] = {
            "rolls_deg": self.rolls_deg if any(self.rolls_deg) else (),
            "films": [_stated(film) for film in self.films],
            "coatings": [coating and _stated(coating) for coating in self.coatings],
            "jaws": [jaws and asdict(jaws) for jaws in self.jaws],
            "contact_shadow": self.contact_shadow,
            "crossing": self.crossing,
        }
        return facts | {name: value for name, value in options.items() if value}


def _stated(part: Any) -> dict[str, Any]:
    """A part of a scene as plain values, without defaults."""
    values = {field: getattr(part, field.name) for field in fields(part)}
    return {
        f.name: value for f, value in values.items() if f.default is MISSING or value != f.default
    }


@dataclass(frozen=True)
class _Draws:
    """The random generators of one image: `paper` for the paper's setting, and one per option."""

    paper: np.random.Generator
    camera: np.random.Generator
    crossing: np.random.Generator
    surface: np.random.Generator
    lens: np.random.Generator
    films: np.random.Generator
    shadow: np.random.Generator
    coatings: np.random.Generator
    jaws: np.random.Generator

    @classmethod
    def of_image(cls, seed: int, index: int) -> "_Draws":
        own = np.random.SeedSequence([seed, index])
        children = own.spawn(len(fields(cls)) - 1)
        return cls(*(np.random.default_rng(sequence) for sequence in (own, *children)))


@dataclass(frozen=True)
class SceneSampler:
    """Draws scenes; image `index` depends on `(seed, index)` alone."""

    settings: RenderSettings
    backgrounds: Sequence[Path]
    seed: int

    def candidates(self, index: int) -> Iterator[Scene]:
        """Successive draws for image `index`, for a caller that may reject some; `tries` is
        cumulative.

        All have as many shafts and occluders as the first: otherwise scenes that are rejected more
        often would become rare.
        """
        draws = _Draws.of_image(self.seed, index)
        first = scene = self._draw(draws)
        tries = first.tries
        while True:
            if _counts(scene) == _counts(first):
                yield replace(scene, tries=tries)
            scene = self._draw(draws)
            tries += scene.tries

    def _draw(self, draws: _Draws) -> Scene:
        settings, rng = self.settings, draws.paper
        rod = surrounding_rod(settings.shaft)
        camera = sample_camera(draws.camera, settings)
        background = self.backgrounds[int(rng.integers(len(self.backgrounds)))]
        sampler = PoseSampler(camera, settings.poses, rod, settings.scene)
        sampled, crossing = self._sample_poses(draws, sampler)
        steels = [sample_steel(rng, settings.scene) for _ in sampled.poses]
        steels += [sample_steel(draws.crossing, settings.scene) for _ in crossing]
        turned = [sample_turning(draws.surface, settings.scene) for _ in steels]
        return Scene(
            background=background,
            camera=camera,
            shafts=sampled.poses + crossing,
            rolls_deg=tuple(0.0 if self._revolved else roll_deg for roll_deg, _ in turned),
            steels=tuple(
                replace(steel, anisotropy=anisotropy)
                for steel, (_, anisotropy) in zip(steels, turned, strict=True)
            ),
            light=sample_light(rng, settings.scene),
            occluders=sample_occluders(rng, sampled.poses, settings),
            lens=sample_lens(rng, draws.lens, settings.lens),
            sensor_seed=int(rng.integers(2**31)),
            tries=sampled.tries,
            films=sample_films(draws.films, len(steels), settings.scene),
            coatings=sample_coatings(draws.coatings, len(steels), settings),
            jaws=sample_jaws(draws.jaws, len(steels), settings),
            contact_shadow=_uniform(draws.shadow, settings.scene.contact_shadow),
            crossing=len(crossing),
        )

    @property
    def _revolved(self) -> bool:
        return instrument_shape(self.settings.shaft).revolved

    def _sample_poses(
        self, draws: _Draws, sampler: PoseSampler
    ) -> tuple[SampledPoses, tuple[ShaftPose, ...]]:
        """The image's shafts and, with the settings' probability, one that crosses in front of
        them; never in an image without shafts.

        Raises InputError if no crossing shaft is found.
        """
        wanted = draws.crossing.random() < self.settings.scene.crossing_probability
        tries = 0
        for _ in range(_MOST_REDRAWS):
            sampled = sampler(draws.paper)
            tries += sampled.tries
            sampled = replace(sampled, tries=tries)
            if not wanted or not sampled.poses:
                return sampled, ()
            crossing = sampler.crossing(draws.crossing, sampled.poses)
            if crossing is not None:
                return sampled, (crossing,)
        raise InputError(
            "params.yaml: scene.crossing_probability: no shaft within `poses` was found that "
            f"crosses one of {_MOST_REDRAWS} others and hides scene.crossing_coverage of it; widen "
            "the ranges, or set it to 0"
        )


def _counts(scene: Scene) -> tuple[int, int, int]:
    return len(scene.shafts), len(scene.occluders), scene.crossing


def sample_camera(rng: np.random.Generator, settings: RenderSettings) -> Camera:
    """A camera whose distortion lies within the settings' ranges."""
    distortion = settings.lens.distortion
    return camera_with(settings, _uniform(rng, distortion.k1), _uniform(rng, distortion.k2))


def sample_steel(rng: np.random.Generator, scene: SceneSettings) -> Steel:
    """Steel within the settings' ranges."""
    return Steel(
        grey=_uniform(rng, scene.steel_grey),
        roughness=_uniform(rng, scene.roughness),
        scratches=_uniform(rng, scene.scratches),
        grain=float(rng.uniform(2.0, 8.0)),
    )


def sample_turning(rng: np.random.Generator, scene: SceneSettings) -> tuple[float, float]:
    """A shaft's roll in degrees, and the anisotropy of its steel within the settings' range."""
    return float(rng.uniform(0, 360)), _uniform(rng, scene.anisotropy)


def sample_films(rng: np.random.Generator, shafts: int, scene: SceneSettings) -> tuple[Film, ...]:
    """A film of blood or clear fluid for each shaft, unless the settings have none."""
    if not scene.films[1]:
        return ()
    return tuple(
        Film(
            blood=bool(rng.random() < 0.5),
            coverage=_uniform(rng, scene.films),
            pattern_mm=(float(rng.uniform(0, 1000)), float(rng.uniform(0, 1000)), 0.0),
        )
        for _ in range(shafts)
    )


def sample_coatings(
    rng: np.random.Generator, shafts: int, settings: RenderSettings
) -> tuple[Coating | None, ...]:
    """A polymer coating for each shaft with the settings' probability, unless that is 0."""
    scene = settings.scene
    if not scene.coating_probability:
        return ()
    drawn = [
        (rng.random(), _coating(rng, scene, settings.shaft.diameter_mm)) for _ in range(shafts)
    ]
    return tuple(
        coating if chance < scene.coating_probability else None for chance, coating in drawn
    )


def _coating(rng: np.random.Generator, scene: SceneSettings, diameter_mm: float) -> Coating:
    # Reflectances of polymers span two orders of magnitude: uniform in the logarithm.
    grey = float(np.exp(rng.uniform(*np.log(scene.coating_grey))))
    red, green, blue = np.clip(grey * rng.normal(1, 0.06, 3), 0, 1).tolist()
    bare = rng.random() < _BARE_TIPS
    return Coating(
        rgb=(red, green, blue),
        roughness=_uniform(rng, scene.coating_roughness),
        bare_mm=float(rng.uniform(0, _LONGEST_BARE)) * diameter_mm if bare else 0.0,
        marks_seed=int(rng.integers(2**31)),
    )


def sample_jaws(
    rng: np.random.Generator, shafts: int, settings: RenderSettings
) -> tuple[Jaws | None, ...]:
    """Jaws for each shaft with the settings' probability, unless that is 0."""
    if not settings.scene.jaws_probability:
        return ()
    drawn = [(rng.random(), _jaws(rng, settings)) for _ in range(shafts)]
    return tuple(
        jaws if chance < settings.scene.jaws_probability else None for chance, jaws in drawn
    )


def _jaws(rng: np.random.Generator, settings: RenderSettings) -> Jaws:
    diameter, width = settings.shaft.diameter_mm, _uniform(rng, _JAW_WIDTHS)
    least, most = _JAW_OPENINGS_DEG
    return Jaws(
        opening_deg=_uniform(rng, (_LEAST_OPENING_DEG if width > _WIDE_JAWS else least, most)),
        width_mm=width * diameter,
        length_mm=_uniform(rng, _JAW_LENGTHS) * diameter,
        roll_deg=float(rng.uniform(0, 360)),
        steel=sample_steel(rng, settings.scene),
    )


def sample_light(rng: np.random.Generator, scene: SceneSettings) -> Light:
    """Light within the settings' ranges."""
    return Light(
        strength=_uniform(rng, scene.light_strength),
        kelvin=_uniform(rng, scene.light_kelvin),
        ambient=_uniform(rng, scene.ambient),
    )


def sample_lens(rng: np.random.Generator, further: np.random.Generator, lens: LensSettings) -> Lens:
    """Effects of lens, air and sensor within the settings' ranges; motion and JPEG compression are
    drawn from `further`."""
    way_px, angle = _uniform(further, lens.motion_px), float(further.uniform(0, np.pi))
    quality = lens.jpeg_quality
    return Lens(
        blur_px=_uniform(rng, lens.blur_px),
        haze=_uniform(rng, lens.haze),
        vignette=_uniform(rng, lens.vignette),
        noise=_uniform(rng, lens.noise),
        motion_px=(way_px * cos(angle), way_px * sin(angle)),
        jpeg_quality=None if quality is None else int(further.integers(quality[0], quality[1] + 1)),
    )


def sample_occluders(
    rng: np.random.Generator,
    poses: Sequence[ShaftPose],
    settings: RenderSettings,
) -> tuple[Occluder, ...]:
    """With the settings' probability one lump of tissue in front of each shaft, else none."""
    if rng.random() >= settings.scene.occluder_probability:
        return ()
    # The rod around a bulky mesh is far thicker than the part to hide.
    thickness_mm = min(settings.shaft.diameter_mm, instrument_shape(settings.shaft).diameter_mm)
    return tuple(_occluder_before(rng, pose, thickness_mm) for pose in poses)


def _occluder_before(rng: np.random.Generator, pose: ShaftPose, thickness_mm: float) -> Occluder:
    """A lump on the line of sight to a point within 15 mm of the tip."""
    hidden = pose.tip_mm + float(rng.uniform(-1, 15)) * pose.direction
    hidden[2] = max(hidden[2], 4.0)
    # 55..75 % of the way to the shaft: in front of it, except a few large lumps that reach it.
    share = float(rng.uniform(0.55, 0.75))
    centre = share * hidden
    room = np.linalg.norm(hidden - centre) - thickness_mm / 2
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
