"""The scene of one image, independent of the renderer, and its sampling.

Image k of a dataset depends on (dataset seed, k) alone. Each part of a scene is drawn from a random
stream of its own name, so an option may come or go and leave the rest of the image unchanged.
"""

from collections.abc import Iterator, Sequence
from dataclasses import MISSING, asdict, dataclass, fields, replace
from itertools import count
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.random_streams import Streams, streams
from shaftpose.rendering.optics import camera_with
from shaftpose.rendering.poses import PoseSampler, SampledPoses
from shaftpose.rendering.shapes import instrument_shape, surrounding_rod
from shaftpose.settings.schema import LensSettings, Range, RenderSettings, SceneSettings

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
class _Contents:
    """Number of shafts, without a crossing one; whether one crosses in front of them; and whether
    tissue hides them."""

    shafts: int
    crossed: bool
    occluded: bool


@dataclass(frozen=True)
class SceneSampler:
    """Draws scenes; image `index` depends on `(seed, index)` alone."""

    settings: RenderSettings
    backgrounds: Sequence[Path]
    seed: int

    def candidates(self, index: int) -> Iterator[Scene]:
        """Successive draws for image `index`, for a caller that may reject some; `tries` is
        cumulative.

        All have the same number of shafts and occluders: otherwise scenes that are rejected more
        often would become rare.
        """
        contents = self._contents(streams(self.seed, index))
        tries = 0
        for attempt in count():
            scene = self._draw(streams(self.seed, index, attempt), contents)
            tries += scene.tries
            yield replace(scene, tries=tries)

    def _contents(self, stream: Streams) -> _Contents:
        scene = self.settings.scene
        fewest, most = scene.instruments
        shafts = int(stream("number of shafts").integers(fewest, most + 1))
        crossed = stream("whether crossed").random() < scene.crossing_probability
        occluded = stream("whether occluded").random() < scene.occluder_probability
        return _Contents(shafts, crossed and shafts > 0, occluded)

    def _draw(self, stream: Streams, contents: _Contents) -> Scene:
        settings, scene = self.settings, self.settings.scene
        camera = sample_camera(stream("camera"), settings)
        sampled, crossing = self._sample_poses(stream, camera, contents)
        shafts = sampled.poses + crossing
        hidden = sampled.poses if contents.occluded else ()
        return Scene(
            background=self.backgrounds[int(stream("background").integers(len(self.backgrounds)))],
            camera=camera,
            shafts=shafts,
            rolls_deg=self._rolls(stream("rolls"), len(shafts)),
            steels=sample_steels(stream, len(shafts), scene),
            light=sample_light(stream("light"), scene),
            occluders=sample_occluders(stream("occluders"), hidden, settings),
            lens=sample_lens(stream, settings.lens),
            sensor_seed=int(stream("sensor").integers(2**31)),
            tries=sampled.tries,
            films=sample_films(stream("films"), len(shafts), scene),
            coatings=sample_coatings(stream("coatings"), len(shafts), settings),
            jaws=sample_jaws(stream("jaws"), len(shafts), settings),
            contact_shadow=_uniform(stream("contact shadow"), scene.contact_shadow),
            crossing=len(crossing),
        )

    def _rolls(self, rng: np.random.Generator, shafts: int) -> tuple[float, ...]:
        """Rolls in degrees; 0 where none is visible."""
        if instrument_shape(self.settings.shaft).revolved:
            return (0.0,) * shafts
        return tuple(rng.uniform(0, 360, shafts).tolist())

    def _sample_poses(
        self, stream: Streams, camera: Camera, contents: _Contents
    ) -> tuple[SampledPoses, tuple[ShaftPose, ...]]:
        """The image's shafts and, if wanted, one that crosses in front of them.

        Raises InputError if no crossing shaft is found.
        """
        rod = surrounding_rod(self.settings.shaft)
        sampler = PoseSampler(camera, self.settings.poses, rod, self.settings.scene)
        poses, crossing_pose = stream("poses"), stream("crossing pose")
        tries = 0
        for _ in range(_MOST_REDRAWS):
            sampled = sampler(poses, contents.shafts)
            tries += sampled.tries
            sampled = replace(sampled, tries=tries)
            if not contents.crossed:
                return sampled, ()
            crossing = sampler.crossing(crossing_pose, sampled.poses)
            if crossing is not None:
                return sampled, (crossing,)
        raise InputError(
            "params.yaml: scene.crossing_probability: no shaft within `poses` was found that "
            f"crosses one of {_MOST_REDRAWS} others and hides scene.crossing_coverage of it; widen "
            "the ranges, or set it to 0"
        )


def sample_camera(rng: np.random.Generator, settings: RenderSettings) -> Camera:
    """A camera whose distortion lies within the settings' ranges."""
    distortion = settings.lens.distortion
    return camera_with(settings, _uniform(rng, distortion.k1), _uniform(rng, distortion.k2))


def sample_steels(stream: Streams, shafts: int, scene: SceneSettings) -> tuple[Steel, ...]:
    """The steel of each shaft within the settings' ranges."""
    steel, anisotropy = stream("steels"), stream("anisotropy")
    return tuple(
        replace(sample_steel(steel, scene), anisotropy=_uniform(anisotropy, scene.anisotropy))
        for _ in range(shafts)
    )


def sample_steel(rng: np.random.Generator, scene: SceneSettings) -> Steel:
    """Isotropic steel within the settings' ranges."""
    return Steel(
        grey=_uniform(rng, scene.steel_grey),
        roughness=_uniform(rng, scene.roughness),
        scratches=_uniform(rng, scene.scratches),
        grain=float(rng.uniform(2.0, 8.0)),
    )


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


def sample_lens(stream: Streams, lens: LensSettings) -> Lens:
    """Effects of lens, air and sensor within the settings' ranges."""
    quality = lens.jpeg_quality
    return Lens(
        blur_px=_uniform(stream("blur"), lens.blur_px),
        haze=_uniform(stream("haze"), lens.haze),
        vignette=_uniform(stream("vignette"), lens.vignette),
        noise=_uniform(stream("noise"), lens.noise),
        motion_px=_motion(stream("motion"), lens.motion_px),
        jpeg_quality=quality and int(stream("JPEG quality").integers(quality[0], quality[1] + 1)),
    )


def _motion(rng: np.random.Generator, lengths_px: Range) -> tuple[float, float]:
    length_px, angle = _uniform(rng, lengths_px), float(rng.uniform(0, np.pi))
    return length_px * cos(angle), length_px * sin(angle)


def sample_occluders(
    rng: np.random.Generator, poses: Sequence[ShaftPose], settings: RenderSettings
) -> tuple[Occluder, ...]:
    """One lump of tissue in front of each of `poses`."""
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
