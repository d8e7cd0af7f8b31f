"""Sampling of scenes.

Image k of a dataset depends on (dataset seed, k) alone. Each part of a scene is drawn from a random
stream of its own name, so an option may come or go and leave the rest of the image unchanged.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.random_streams import Streams, streams
from shaftpose.rendering.part_samplers import (
    sample_camera,
    sample_coatings,
    sample_films,
    sample_jaws,
    sample_lens,
    sample_light,
    sample_occluders,
    sample_rolls,
    sample_samples,
    sample_steels,
    uniform,
)
from shaftpose.rendering.poses import PoseSampler, SampledPoses
from shaftpose.rendering.scene import Scene
from shaftpose.rendering.shapes import surrounding_rod
from shaftpose.settings.schema import RenderSettings

_MOST_REDRAWS = 100


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
            background=self.backgrounds[stream("background").integers(len(self.backgrounds))],
            camera=camera,
            shafts=shafts,
            rolls_deg=sample_rolls(stream("rolls"), len(shafts), settings),
            steels=sample_steels(stream, len(shafts), scene),
            light=sample_light(stream("light"), scene),
            occluders=sample_occluders(stream("occluders"), hidden, settings),
            lens=sample_lens(stream, settings.lens),
            sensor_seed=int(stream("sensor").integers(2**31)),
            tries=sampled.tries,
            samples=sample_samples(stream("samples"), settings.samples),
            films=sample_films(stream("films"), len(shafts), scene),
            coatings=sample_coatings(stream("coatings"), len(shafts), settings),
            jaws=sample_jaws(stream("jaws"), len(shafts), settings),
            contact_shadow=uniform(stream("contact shadow"), scene.contact_shadow),
            crossing=len(crossing),
        )

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
