"""`shaftpose real fetch`: public endoscopic images, joined with this project's annotations.

Instruments: 89 frames of 13 laparoscopic operations and 738 of 15 laparoscopic and robotic ones, in
parts for training, validation and tests that share no operation (`real_images/parts.csv`).
Backgrounds: squares without instruments, of no operation of validation or tests.
"""

import argparse
import csv
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shaftpose.core.errors import InputError
from shaftpose.core.files import naming_refusal, new_file, read_json, write_json
from shaftpose.core.images import centre_square, write_jpeg
from shaftpose.image_files.reading import read_rgb

_ANNOTATIONS = Path(__file__).with_name("real_images")
_PARTS = ("train.json", "validation.json", "test.json")
_BACKGROUND_PX = 512
_BATCH = 40  # images that an interrupted download may lose
_GIT_LIMIT_S = 900  # for one batch, or for a repository without its images
# git gives up below 1 kB/s for a minute; it asks for no password, since none is needed.
_GIT_ENVIRONMENT = {
    "GIT_HTTP_LOW_SPEED_LIMIT": "1000",
    "GIT_HTTP_LOW_SPEED_TIME": "60",
    "GIT_TERMINAL_PROMPT": "0",
}
# A checkout alone would fetch the contents of files one by one.
_FETCH = (
    *("-c", "fetch.negotiationAlgorithm=noop", "fetch", "--quiet", "--no-tags"),
    *("--no-write-fetch-head", "--filter=blob:none", "origin"),
)


@dataclass(frozen=True)
class Repository:
    """A public repository of images at one commit; licence: its terms, for a notice."""

    url: str
    commit: str
    licence: str


FRAMES, TOOLS = "laparoscopic-dataset", "surgical-segmentation"
_TOOLS_FOLDER = "source_code/model-training-files/datasets/surgical-segmentation-3"
REPOSITORIES = {
    FRAMES: Repository(
        "https://github.com/egoodman92/laparoscopic-dataset",
        "88d8b5108bf9c852d87fc4ca45aa101da5a7cfb2",
        "MIT",
    ),
    TOOLS: Repository(
        "https://github.com/yousskad/"
        "Informative-vs-Uninformative-Surgical-Video-Frame-Classification",
        "8afa089570433120bee88636c44c40318d4cce8f",
        "CC BY 4.0: images, and outlines of whole tools and of the view, here rounded to whole "
        "pixels: Roboflow user works-ly0n7, project surgical-segmentation-yh9n7, version 3",
    ),
    "vocalfolds": Repository(
        "https://github.com/imesluh/vocalfolds",
        "82485aea8db1fe87d5a2f6bab8997a1f4ce9d9c4",
        "CC BY 4.0: Laves, Bicker, Kahrs, Ortmaier, A Dataset of Laryngeal Endoscopic Images with "
        "Comparative Study on Convolution Neural Network Based Semantic Segmentation, 2019",
    ),
}


@dataclass(frozen=True)
class Frame:
    """An image of a repository, copied as it is. file: in the repository; target: in the folder."""

    repository: str
    file: str
    target: str

    def is_in(self, folder: Path, blobs: Mapping[str, str]) -> bool:
        """Whether the folder holds it. blobs: file -> git's blob hash of its content."""
        path = folder / self.target
        return path.is_file() and _blob(path.read_bytes()) == blobs.get(self.file)

    def write(self, clone: Path, folder: Path) -> None:
        """Copy it from a clone of its repository."""
        with new_file(folder / self.target) as path:
            shutil.copyfile(clone / self.file, path)


@dataclass(frozen=True)
class Square:
    """A square x, y, size of an image of a repository, written as a background.

    Each operation has a folder, which counts as one source of backgrounds.
    """

    repository: str
    file: str
    operation: str
    x: int
    y: int
    size: int

    @property
    def target(self) -> str:
        """The file in the folder."""
        name = f"{self.repository}-{self.operation}/{Path(self.file).stem}.jpg"
        return f"backgrounds/{name}"

    def is_in(self, folder: Path, blobs: Mapping[str, str]) -> bool:
        """Whether the folder holds it."""
        return (folder / self.target).is_file()

    def write(self, clone: Path, folder: Path) -> None:
        """Cut it from a clone of its repository."""
        rgb = read_rgb(clone / self.file)[self.y : self.y + self.size, self.x : self.x + self.size]
        write_jpeg(centre_square(rgb, _BACKGROUND_PX), folder / self.target)


def run(options: argparse.Namespace) -> None:
    """Write images, the COCO files of the parts, backgrounds and `SOURCES.txt` to a folder."""
    with naming_refusal(options.folder, "name another folder"):
        fetch(options.folder, REPOSITORIES)
    print(
        f"{options.folder} holds the images. To use them, set in params.yaml:\n"
        f"  real.source: {options.folder}\n  backgrounds.source: {options.folder / 'backgrounds'}"
    )


def fetch(out: Path, repositories: Mapping[str, Repository]) -> None:
    """Download the images that the annotations need, and write them to a folder.

    Images that the folder holds are kept. Raises InputError if it holds other annotations, git is
    missing or a download fails.
    """
    parts = {name: annotations(name) for name in _PARTS}
    for name, content in parts.items():
        if (out / name).exists() and read_json(out / name, "name a new folder") != content:
            raise InputError(f"{out / name}: would be replaced; name a new folder")
    squares = _squares(_ANNOTATIONS / "backgrounds.csv")
    images: list[Frame | Square] = [*_frames(parts), *squares]
    for name, repository in repositories.items():
        _download(repository, [image for image in images if image.repository == name], out)
    for name, content in parts.items():
        write_json(out / name, content)
    notices = [f"{r.url} at {r.commit}: {r.licence}\n" for r in repositories.values()]
    with new_file(out / "SOURCES.txt") as path:
        own = "Outlines of shafts, their tips and tails: the shaftpose project, CC0\n"
        path.write_text("".join([*notices, own]))


def annotations(name: str) -> dict[str, Any]:
    """The COCO file of a part, completed by the values that follow from its polygons."""
    content: dict[str, Any] = read_json(_ANNOTATIONS / name, "install shaftpose again")
    for annotation in content["annotations"]:
        annotation |= {"iscrowd": 0} | _extent(annotation["segmentation"])
    return content


def _extent(polygons: Sequence[Sequence[float]]) -> dict[str, Any]:
    """`bbox` and `area` of polygons x, y, x, y, ... that do not overlap."""
    xs, ys = ([v for polygon in polygons for v in polygon[axis::2]] for axis in (0, 1))
    x, y = min(xs), min(ys)
    return {"bbox": [x, y, max(xs) - x, max(ys) - y], "area": sum(map(_area, polygons))}


def _area(polygon: Sequence[float]) -> float:
    xs, ys = polygon[::2], polygon[1::2]
    before = zip([xs[-1], *xs], [ys[-1], *ys], xs, ys, strict=False)
    return abs(sum(x0 * y - x * y0 for x0, y0, x, y in before)) / 2


def _frames(parts: Mapping[str, dict[str, Any]]) -> Iterator[Frame]:
    for image in (image for content in parts.values() for image in content["images"]):
        if "source" in image:
            yield Frame(TOOLS, f"{_TOOLS_FOLDER}/{image['source']}", image["file_name"])
        else:
            yield Frame(FRAMES, image["file_name"], image["file_name"])


def _squares(path: Path) -> Iterator[Square]:
    with path.open(newline="") as stream:
        for row in csv.DictReader(stream):
            square = (int(row[name]) for name in ("crop_x", "crop_y", "crop_size"))
            yield Square(row["repository"], row["file"], row["operation"], *square)


def _download(repository: Repository, images: Sequence[Frame | Square], out: Path) -> None:
    """Write the images of a repository that a folder lacks, in batches: finished ones are kept."""
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder)
        _git("clone", "--quiet", "--filter=blob:none", "--no-checkout", repository.url, folder)
        blobs = _blobs(_git("-C", folder, "ls-tree", "-r", "-z", repository.commit))
        missing = [image for image in images if not image.is_in(out, blobs)]
        held = len(images) - len(missing)
        print(f"{repository.url}: {len(missing)} images to download, {held} are in {out}")
        for start in range(0, len(missing), _BATCH):
            batch = missing[start : start + _BATCH]
            files = sorted({image.file for image in batch})
            _git("-C", folder, *_FETCH, *{blobs[file] for file in files if file in blobs})
            _git("-C", folder, "checkout", "--quiet", repository.commit, "--", *files)
            for image in batch:
                image.write(clone, out)


def _blobs(listing: str) -> dict[str, str]:
    """file -> git's blob hash of it, from its listing `mode blob HASH<tab>FILE`."""
    entries = (entry.partition("\t") for entry in listing.split("\0") if entry)
    return {file: about.split()[2] for about, _, file in entries}


def _blob(content: bytes) -> str:
    """git's blob hash of a file's content."""
    header = f"blob {len(content)}\0".encode()
    return hashlib.sha1(header + content, usedforsecurity=False).hexdigest()


def _git(*arguments: str) -> str:
    """The output of a git command. Raises InputError if git is missing, fails or takes too long."""
    again = "check the connection and run the command again: finished images are kept"
    try:
        return subprocess.run(
            ["git", *arguments],
            check=True,
            capture_output=True,
            text=True,
            env=os.environ | _GIT_ENVIRONMENT,
            timeout=_GIT_LIMIT_S,
        ).stdout
    except FileNotFoundError as error:
        raise InputError("git was not found; install it to fetch real images") from error
    except subprocess.TimeoutExpired as error:
        raise InputError(f"git: not finished after {error.timeout:.0f} s; {again}") from error
    except subprocess.CalledProcessError as error:
        reason = " ".join(error.stderr.split()) or f"status {error.returncode}"
        raise InputError(f"git: {reason}; {again}") from error
