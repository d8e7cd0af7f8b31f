"""Samplers of the parts of a scene, within the settings' ranges."""

from collections.abc import Sequence
from dataclasses import replace
from math import cos, sin

import numpy as np

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.random_streams import Streams
from shaftpose.rendering.optics import camera_with
from shaftpose.rendering.scene import Coating, Film, Jaws, Lens, Light, Occluder, Steel
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.settings.schema import LensSettings, Range, RenderSettings, SceneSettings

# Estimated in laparoscopic images. Lengths and widths are in diameters of the shaft.
_BARE_TIPS, _LONGEST_BARE = 0.2, 1.0  # share of coated shafts with a bare steel end; its length
_JAW_WIDTHS, _JAW_LENGTHS = (0.4, 1.0), (0.8, 4.0)
# In annotations of real images, closed jaws in line with the shaft and as wide as it are shaft:
# nobody sees where they begin. Rendered jaws are all tool, so none are closed; wide jaws must open
# more to look like jaws.
_JAW_OPENINGS_DEG = 8.0, 70.0
_WIDE_JAWS, _LEAST_OPENING_DEG = 0.8, 15.0


def uniform(rng: np.random.Generator, ends: Range) -> float:
    """A value between the two ends of a range."""
    return float(rng.uniform(*ends))


def sample_camera(rng: np.random.Generator, settings: RenderSettings) -> Camera:
    """A camera whose distortion lies within the settings' ranges."""
    distortion = settings.lens.distortion
    return camera_with(settings, uniform(rng, distortion.k1), uniform(rng, distortion.k2))


def sample_rolls(
    rng: np.random.Generator, shafts: int, settings: RenderSettings
) -> tuple[float, ...]:
    """The roll of each shaft in degrees; 0 for instruments on which none is visible."""
    if instrument_shape(settings.shaft).revolved:
        return (0.0,) * shafts
    return tuple(rng.uniform(0, 360, shafts).tolist())


def sample_steels(stream: Streams, shafts: int, scene: SceneSettings) -> tuple[Steel, ...]:
    """The steel of each shaft within the settings' ranges."""
    steel, anisotropy = stream("steels"), stream("anisotropy")
    return tuple(
        replace(sample_steel(steel, scene), anisotropy=uniform(anisotropy, scene.anisotropy))
        for _ in range(shafts)
    )


def sample_steel(rng: np.random.Generator, scene: SceneSettings) -> Steel:
    """Isotropic steel within the settings' ranges."""
    return Steel(
        grey=uniform(rng, scene.steel_grey),
        roughness=uniform(rng, scene.roughness),
        scratches=uniform(rng, scene.scratches),
        grain=float(rng.uniform(2.0, 8.0)),
    )


def sample_films(rng: np.random.Generator, shafts: int, scene: SceneSettings) -> tuple[Film, ...]:
    """A film of blood or clear fluid for each shaft; empty if the settings have none."""
    if not scene.films[1]:
        return ()
    return tuple(
        Film(
            blood=bool(rng.random() < 0.5),
            coverage=uniform(rng, scene.films),
            pattern_mm=(float(rng.uniform(0, 1000)), float(rng.uniform(0, 1000)), 0.0),
        )
        for _ in range(shafts)
    )


def sample_coatings(
    rng: np.random.Generator, shafts: int, settings: RenderSettings
) -> tuple[Coating | None, ...]:
    """A coating or None for each shaft, by the settings' probability; empty if that is 0."""
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
        roughness=uniform(rng, scene.coating_roughness),
        bare_mm=float(rng.uniform(0, _LONGEST_BARE)) * diameter_mm if bare else 0.0,
        marks_seed=int(rng.integers(2**31)),
    )


def sample_jaws(
    rng: np.random.Generator, shafts: int, settings: RenderSettings
) -> tuple[Jaws | None, ...]:
    """Jaws or None for each shaft, by the settings' probability; empty if that is 0."""
    if not settings.scene.jaws_probability:
        return ()
    drawn = [(rng.random(), _jaws(rng, settings)) for _ in range(shafts)]
    return tuple(
        jaws if chance < settings.scene.jaws_probability else None for chance, jaws in drawn
    )


def _jaws(rng: np.random.Generator, settings: RenderSettings) -> Jaws:
    diameter, width = settings.shaft.diameter_mm, uniform(rng, _JAW_WIDTHS)
    least, most = _JAW_OPENINGS_DEG
    return Jaws(
        opening_deg=uniform(rng, (_LEAST_OPENING_DEG if width > _WIDE_JAWS else least, most)),
        width_mm=width * diameter,
        length_mm=uniform(rng, _JAW_LENGTHS) * diameter,
        roll_deg=float(rng.uniform(0, 360)),
        steel=sample_steel(rng, settings.scene),
    )


def sample_light(rng: np.random.Generator, scene: SceneSettings) -> Light:
    """Light within the settings' ranges."""
    return Light(
        strength=uniform(rng, scene.light_strength),
        kelvin=uniform(rng, scene.light_kelvin),
        ambient=uniform(rng, scene.ambient),
    )


def sample_lens(stream: Streams, lens: LensSettings) -> Lens:
    """Effects of lens, air and sensor within the settings' ranges."""
    quality = lens.jpeg_quality
    return Lens(
        blur_px=uniform(stream("blur"), lens.blur_px),
        haze=uniform(stream("haze"), lens.haze),
        vignette=uniform(stream("vignette"), lens.vignette),
        noise=uniform(stream("noise"), lens.noise),
        motion_px=_motion(stream("motion"), lens.motion_px),
        jpeg_quality=quality and int(stream("JPEG quality").integers(quality[0], quality[1] + 1)),
    )


def _motion(rng: np.random.Generator, lengths_px: Range) -> tuple[float, float]:
    length_px, angle = uniform(rng, lengths_px), float(rng.uniform(0, np.pi))
    return length_px * cos(angle), length_px * sin(angle)


def sample_samples(rng: np.random.Generator, ends: tuple[int, int]) -> int:
    """A number of light paths per pixel: log-uniform, because noise depends on ratios."""
    return round(float(np.exp(rng.uniform(*np.log(ends)))))


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
