"""Stage `backgrounds`: source images, real or procedural, and their colour variations."""

from shaftpose.backgrounds.library import write_backgrounds
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings


@stage
def main(settings: Settings) -> None:
    """Write the background library to `out`."""
    write_backgrounds(
        settings.backgrounds,
        sources=settings.size.sources,
        variations=settings.size.variations,
        side_px=settings.camera.size_px,
        seed=settings.seed,
        out=settings.out,
    )


if __name__ == "__main__":
    main()
