"""What is kept of a checked image: numbers for statistics and for the split."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ShaftFacts:
    """One shaft. Boxes are those of its visible part; lens_distance_mm is the shortest distance
    from the camera to its axis, occluded_share the hidden share of a shaft that has an occluder,
    else None, silhouette_iou None where it was not compared."""

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
    """One image, drawn from the seed of its set and its index there; `tries` counts the shafts that
    the pose sampler drew for it, `crossing` those that were drawn apart, to pass before others."""

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
