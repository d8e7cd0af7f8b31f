"""Facts of a checked image, for statistics and the split."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ShaftFacts:
    """One shaft.

    The box is that of its visible part. lens_distance_mm: shortest distance from camera to axis;
    occluded_share: hidden share, None without an occluder; silhouette_iou: None if not compared.
    """

    x_mm: float
    y_mm: float
    z_mm: float
    pitch_deg: float
    yaw_deg: float
    visible_fraction: float
    box_width_px: int
    box_height_px: int
    lens_distance_mm: float
    roughness: float
    occluded_share: float | None
    silhouette_iou: float | None


@dataclass(frozen=True, slots=True)
class ImageFacts:
    """One image.

    seed, index: the seed of its set and its number there; tries: shafts that the pose sampler drew
    for it; crossing: shafts drawn separately to pass in front of others.
    """

    key: str
    digest: bytes  # of the image file
    background: str
    source: str
    seed: int
    index: int
    tries: int
    crossing: int
    light_strength: float
    light_kelvin: float
    ambient: float
    shafts: tuple[ShaftFacts, ...]
