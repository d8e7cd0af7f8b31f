"""Image files as a source of frames."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.images import read_rgb
from shaftpose.inference.frames import Frame

SUFFIXES = frozenset((".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"))


@dataclass(frozen=True)
class ImageFile:
    """A file with one image: a `Source` of one frame."""

    path: Path
    length: int = 1

    @property
    def name(self) -> str:
        """The path."""
        return str(self.path)

    def frames(self) -> Iterator[Frame]:
        """The image. Raises InputError naming the file if it is missing or is not an image."""
        yield Frame(self.name, 0, read_rgb(self.path))


def is_image(path: Path) -> bool:
    """Whether a file's name ends as that of an image."""
    return path.suffix.lower() in SUFFIXES


@dataclass(frozen=True)
class EmptyFolder:
    """A folder without images: a `Source` that only says so."""

    path: Path
    reason: str
    length: int = 0

    @property
    def name(self) -> str:
        """The path."""
        return str(self.path)

    def frames(self) -> Iterator[Frame]:
        """Raises InputError naming the folder."""
        raise InputError(f"{self.path}: {self.reason}; images end in {', '.join(sorted(SUFFIXES))}")


def images_of(folder: Path) -> Sequence[ImageFile | EmptyFolder]:
    """The images in a folder, by name; its subfolders are left out."""
    try:
        files = sorted(path for path in folder.iterdir() if is_image(path))
    except OSError as error:
        return [EmptyFolder(folder, f"cannot be read ({error.strerror})")]
    return [ImageFile(path) for path in files] or [EmptyFolder(folder, "holds no image")]
