"""Render images with a preset, in front of the backgrounds in data/backgrounds.

`python -m studies.preset_picture laparoscopy docs/images/laparoscopy_preset.jpg`
"""

import argparse
from pathlib import Path

from tqdm import tqdm

from shaftpose.core.background_index import read_library
from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.images import write_jpeg
from shaftpose.figures.drawing import contact_sheet
from shaftpose.rendering.generator import SampleGenerator
from shaftpose.rendering.image_sets import rendered_sets
from shaftpose.rendering.silhouette import blender_output_hidden
from shaftpose.settings.compose import composed_settings
from shaftpose.settings.tree import Settings

ROOT = Path(__file__).parents[1]
IMAGES, COLUMNS = 18, 6


def main() -> None:
    """Write the picture of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("preset", help="the name of a file of conf/preset")
    parser.add_argument("out", type=Path, help="the JPEG file to write")
    arguments = parser.parse_args()
    with exit_on_input_error():
        name, out = arguments.preset, arguments.out
        draw(composed_settings(ROOT, f"preset={name}", f"profile={name}"), out)


def draw(settings: Settings, out: Path) -> None:
    """Write a contact sheet of the first images of the training set."""
    library, held_out = read_library(Path("data/backgrounds")), settings.backgrounds.held_out
    sets = rendered_sets(settings.rendering, settings.size, library, held_out, settings.seed)
    plan = sets["images"]
    if not all(source.startswith("tissue-") for source in plan.backgrounds.values()):
        raise InputError("data/backgrounds: holds images of others; run the pipeline with its own")
    with blender_output_hidden():
        generator = SampleGenerator(plan.settings, plan.backgrounds, plan.seed)
        images = [
            generator.sample(n).rgb
            for n in tqdm(range(IMAGES), "rendering", unit="image", disable=None)
        ]
    write_jpeg(contact_sheet(images, COLUMNS), out, quality=85)


if __name__ == "__main__":
    main()
