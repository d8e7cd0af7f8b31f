"""Render a film of 16:9 of two moving shafts with known poses.

`python -m studies.moving_shafts OUT --frames 150` writes OUT/film.mp4, its first frame
OUT/frame.jpg, and OUT/poses.json: for each frame, the shafts' poses. A film is cut from squares of
its width, in front of a tissue of its own.
"""

import argparse
from dataclasses import asdict, replace
from math import sin, tau
from pathlib import Path

import cv2
from tqdm import tqdm

from shaftpose.backgrounds.library import write_backgrounds
from shaftpose.core.background_index import read_library
from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.files import write_json
from shaftpose.core.geometry import ShaftPose
from shaftpose.core.images import write_jpeg
from shaftpose.rendering.blender import Renderer
from shaftpose.rendering.generator import photograph
from shaftpose.rendering.image_sets import rendered_sets
from shaftpose.rendering.scene import Scene
from shaftpose.rendering.scene_sampler import SceneSampler
from shaftpose.rendering.silhouette import blender_output_hidden
from shaftpose.settings.compose import composed_settings
from shaftpose.settings.tree import Settings

ROOT = Path(__file__).parents[1]
FPS, WIDTH, HEIGHT = 25.0, 640, 360
FILM, FRAME, POSES = "film.mp4", "frame.jpg", "poses.json"
QUALITY = 95  # of the frame
# One tissue, which the test sets take.
OVERRIDES = (
    "variant=e", "variants=[e]", f"camera.size_px={WIDTH}", "profile=smoke",
    "profiles.smoke.sources=4", "profiles.smoke.variations=1", "profiles.smoke.samples=[32,32]",
    "backgrounds.held_out=0.25",
)  # fmt: skip
# Middle of the motion, amplitude and period in s of x, y, z, pitch and yaw: two hands that enter
# from the sides and work there and in the middle. The right shaft's yaw passes from 359 to 0 deg.
Motion = tuple[tuple[float, float, float], ...]
MOTIONS: tuple[Motion, ...] = (
    ((-9.0, 5.0, 1.9), (2.0, 4.0, 2.7), (18.0, 3.0, 3.7), (68.0, 10.0, 3.1), (165.0, 20.0, 4.3)),
    ((10.0, 5.0, 2.3), (-2.0, 4.0, 3.3), (20.0, 4.0, 2.9), (66.0, 9.0, 4.1), (10.0, 25.0, 3.9)),
)


def main() -> None:
    """Write the film of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", type=Path, help="folder, which is created")
    parser.add_argument("--frames", type=int, default=150, help="number of frames (150)")
    arguments = parser.parse_args()
    with exit_on_input_error():
        write_film(composed_settings(ROOT, *OVERRIDES), arguments.frames, arguments.out)


def poses_at(seconds: float) -> tuple[ShaftPose, ...]:
    """The poses of both shafts at a time."""
    return tuple(_pose_at(motion, seconds) for motion in MOTIONS)


def _pose_at(motion: Motion, seconds: float) -> ShaftPose:
    x_mm, y_mm, z_mm, pitch_deg, yaw_deg = (
        middle + amplitude * sin(tau * seconds / period + phase)
        for phase, (middle, amplitude, period) in enumerate(motion)
    )
    return ShaftPose(x_mm, y_mm, z_mm, pitch_deg, yaw_deg % 360.0)


def write_film(settings: Settings, frames: int, out: Path) -> None:
    """Render the frames and write the film, its first frame and its poses."""
    out.mkdir(parents=True, exist_ok=True)
    first = first_scene(settings, out / "backgrounds")
    scenes = [replace(first, shafts=poses_at(number / FPS)) for number in range(frames)]
    size = WIDTH, HEIGHT
    writer = cv2.VideoWriter(str(out / FILM), cv2.VideoWriter.fourcc(*"mp4v"), FPS, size)
    if not writer.isOpened():
        raise InputError(f"{out / FILM}: cannot be written; name another folder")
    with blender_output_hidden():
        renderer = Renderer(settings.rendering)
    above = (WIDTH - HEIGHT) // 2
    for number, scene in enumerate(tqdm(scenes, "rendering", unit="frame", disable=None)):
        with blender_output_hidden():
            foreground = renderer.render(scene)
        rgb = photograph(scene, foreground, settings.rendering)[above : above + HEIGHT]
        writer.write(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
        if number == 0:
            write_jpeg(rgb, out / FRAME, QUALITY)
    writer.release()
    write_json(out / POSES, [[asdict(pose) for pose in scene.shafts] for scene in scenes])


def first_scene(settings: Settings, backgrounds: Path) -> Scene:
    """A scene of the clear test set with two shafts, in front of tissue that is written there."""
    size, held_out = settings.size, settings.backgrounds.held_out
    write_backgrounds(
        settings.backgrounds, size.sources, size.variations, WIDTH, settings.seed, backgrounds
    )
    library = read_library(backgrounds)
    sets = rendered_sets(settings.rendering, size, library, held_out, settings.seed)
    plan = sets["clear"]
    sampler = SceneSampler(plan.settings, tuple(plan.backgrounds), plan.seed)
    scenes = (next(sampler.candidates(index)) for index in range(100))
    found = next((scene for scene in scenes if len(scene.shafts) == len(MOTIONS)), None)
    if found is None:
        raise InputError("params.yaml: scene.instruments: must allow two shafts")
    return found


if __name__ == "__main__":
    main()
