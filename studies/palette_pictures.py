"""Store PNG pictures of the documentation in 256 colours, a third of the bytes.

`python -m studies.palette_pictures docs/images/*.png`: charts look the same. Pictures that have a
palette already are left as they are.
"""

import argparse
from pathlib import Path

from PIL import Image

from shaftpose.core.files import new_file


def main() -> None:
    """Store the files of the command line anew."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("files", nargs="+", type=Path, help="PNG files")
    for path in parser.parse_args().files:
        store_with_palette(path)


def store_with_palette(path: Path) -> None:
    """Replace a PNG by one of at most 256 colours."""
    with Image.open(path) as picture:
        if picture.mode == "P":
            return
        # Dithering would draw dots into plain areas, which also take more bytes.
        small = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    with new_file(path) as part:
        small.save(part, format="PNG", optimize=True)


if __name__ == "__main__":
    main()
