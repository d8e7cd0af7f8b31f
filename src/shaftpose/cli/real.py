"""`shaftpose real fetch`: public endoscopic images, joined with this project's annotations.

Instruments: 89 laparoscopic frames of 13 operations, 53 for training and 36 of other operations for
tests. Backgrounds: squares without instruments; none is of an operation of the tests.
"""

import argparse
import csv
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.files import naming_refusal, new_file, read_json
from shaftpose.core.images import centre_square, read_rgb, write_jpeg

_ANNOTATIONS = Path(__file__).with_name("real_images")
_PARTS = ("train.json", "test.json")
_BACKGROUND_PX = 512


@dataclass(frozen=True)
class Repository:
    """A public repository of images at one commit; licence: its terms, for a notice."""

    url: str
    commit: str
    licence: str


FRAMES = "laparoscopic-dataset"
REPOSITORIES = {
    FRAMES: Repository(
        "https://github.com/egoodman92/laparoscopic-dataset",
        "88d8b5108bf9c852d87fc4ca45aa101da5a7cfb2",
        "MIT",
    ),
    "vocalfolds": Repository(
        "https://github.com/imesluh/vocalfolds",
        "82485aea8db1fe87d5a2f6bab8997a1f4ce9d9c4",
        "CC BY 4.0: Laves, Bicker, Kahrs, Ortmaier, A Dataset of Laryngeal Endoscopic Images with "
        "Comparative Study on Convolution Neural Network Based Semantic Segmentation, 2019",
    ),
}


@dataclass(frozen=True)
class Crop:
    """A square of an image in a repository; operation: the patient or operation that it shows."""

    repository: str
    file: str
    operation: str
    x: int
    y: int
    size: int


def run(options: argparse.Namespace) -> None:
    """Write `images/`, `train.json`, `test.json`, `backgrounds/` and `SOURCES.txt` to a folder."""
    with naming_refusal(options.folder, "name another folder"):
        fetch(options.folder, REPOSITORIES)
    print(
        f"{options.folder} holds the images. To use them, set in params.yaml:\n"
        f"  real.source: {options.folder}\n  backgrounds.source: {options.folder / 'backgrounds'}"
    )


def fetch(out: Path, repositories: dict[str, Repository]) -> None:
    """Download the images that the annotations need, and write them to a folder.

    Raises InputError if the folder holds annotations already, git is missing or a download fails.
    """
    held = [out / name for name in _PARTS if (out / name).exists()]
    if held:
        raise InputError(f"{held[0]}: would be replaced; name a new folder")
    parts = [read_json(_ANNOTATIONS / name, "install shaftpose again") for name in _PARTS]
    frames = [image["file_name"] for part in parts for image in part["images"]]
    crops = list(_crops(_ANNOTATIONS / "backgrounds.csv"))
    needed = {
        name: [crop.file for crop in crops if crop.repository == name] for name in repositories
    }
    needed[FRAMES] += frames
    with tempfile.TemporaryDirectory() as folder:
        clones = {name: Path(folder) / name for name in repositories}
        for name, repository in repositories.items():
            _check_out(repository, sorted(set(needed[name])), clones[name])
        for frame in frames:
            _copy(clones[FRAMES] / frame, out / frame)
        for crop in crops:
            _write_square(clones[crop.repository] / crop.file, crop, out / "backgrounds")
    for name in _PARTS:
        _copy(_ANNOTATIONS / name, out / name)
    notices = (f"{r.url} at {r.commit}: {r.licence}\n" for r in repositories.values())
    with new_file(out / "SOURCES.txt") as path:
        path.write_text("".join(chain(notices, ["Annotations: the shaftpose project, CC0\n"])))


def _crops(path: Path) -> Iterator[Crop]:
    with path.open(newline="") as stream:
        for row in csv.DictReader(stream):
            square = (int(row[name]) for name in ("crop_x", "crop_y", "crop_size"))
            yield Crop(row["repository"], row["file"], row["operation"], *square)


def _check_out(repository: Repository, paths: Sequence[str], clone: Path) -> None:
    """Clone a repository without its files, then get those of `paths` at its commit."""
    print(f"downloading {len(paths)} images of {repository.url}")
    _git("clone", "--quiet", "--filter=blob:none", "--no-checkout", repository.url, str(clone))
    _git("-C", str(clone), "checkout", "--quiet", repository.commit, "--", *paths)


def _git(*arguments: str) -> None:
    try:
        never_asking = os.environ | {"GIT_TERMINAL_PROMPT": "0"}  # no password is needed
        subprocess.run(
            ["git", *arguments], check=True, capture_output=True, text=True, env=never_asking
        )
    except FileNotFoundError as error:
        raise InputError("git was not found; install it to fetch real images") from error
    except subprocess.CalledProcessError as error:
        reason = " ".join(error.stderr.split()) or f"status {error.returncode}"
        raise InputError(
            f"git: {reason}; check the connection and run the command again"
        ) from error


def _copy(source: Path, target: Path) -> None:
    with new_file(target) as path:
        shutil.copyfile(source, path)


def _write_square(source: Path, crop: Crop, out: Path) -> None:
    """Write a crop into the folder of its operation, which counts as one source of backgrounds."""
    rgb = read_rgb(source)[crop.y : crop.y + crop.size, crop.x : crop.x + crop.size]
    square = centre_square(rgb, _BACKGROUND_PX)
    name = f"{crop.repository}-{crop.operation}"
    write_jpeg(square, out / name / f"{Path(crop.file).stem}.jpg")
