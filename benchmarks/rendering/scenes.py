"""The scenes of a set's first images."""

from shaftpose.rendering.jobs import RenderedSet
from shaftpose.rendering.scene import Scene, SceneSampler


def first_scenes(rendered: RenderedSet, count: int) -> list[Scene]:
    """What images 0 .. count - 1 show: without occluders, each is the first draw."""
    sampler = SceneSampler(rendered.settings, tuple(rendered.backgrounds), rendered.seed)
    return [next(sampler.candidates(index)) for index in range(count)]
