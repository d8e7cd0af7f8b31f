"""The scene of one image, independent of the renderer."""

from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path
from typing import Any

from shaftpose.core.geometry import Camera, ShaftPose


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
    """Steel jaws in front of a shaft's tip: part of the tool mask, not of the annotated shaft."""

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
    shafts that the pose sampler drew, without crossing ones; samples: light paths per pixel."""

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
    samples: int
    films: tuple[Film, ...] = ()  # one per shaft, or none at all
    coatings: tuple[Coating | None, ...] = ()  # one per shaft, or none at all
    jaws: tuple[Jaws | None, ...] = ()  # one per shaft, or none at all
    contact_shadow: float = 0.0
    crossing: int = 0  # number of shafts, the last ones, sampled to cross in front of another

    def description(self) -> dict[str, Any]:
        """Everything except poses, background and camera as plain values, for shaft.json; options
        that are off are omitted."""
        stated: dict[str, Any] = {
            "light": _stated(self.light),
            "steels": [_stated(steel) for steel in self.steels],
            "occluders": [_stated(occluder) for occluder in self.occluders],
            "lens": _stated(self.lens),
            "tries": self.tries,
            "samples": self.samples,
        }
        options: dict[str, Any] = {
            "rolls_deg": self.rolls_deg if any(self.rolls_deg) else (),
            "films": [_stated(film) for film in self.films],
            "coatings": [coating and _stated(coating) for coating in self.coatings],
            "jaws": [jaws and asdict(jaws) for jaws in self.jaws],
            "contact_shadow": self.contact_shadow,
            "crossing": self.crossing,
        }
        return stated | {name: value for name, value in options.items() if value}


def _stated(part: Any) -> dict[str, Any]:
    """A part of a scene as plain values, without defaults."""
    values = {field: getattr(part, field.name) for field in fields(part)}
    return {
        f.name: value for f, value in values.items() if f.default is MISSING or value != f.default
    }
