"""Checks of finished rendered sets: all shards and images are present and correct."""

import logging
import tarfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from operator import attrgetter
from pathlib import Path

from tqdm import tqdm

from shaftpose.checks.checked_image import CheckedImage
from shaftpose.checks.expected_sets import ExpectedSet
from shaftpose.checks.image_checks import check_image
from shaftpose.core.errors import InputError
from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.core.samples import sample_key
from shaftpose.core.shard_index import is_whole, rerender

logger = logging.getLogger(__name__)

MOST_NAMED = 20
_pose = attrgetter(*POSE_DIMENSIONS)


@dataclass(frozen=True)
class Problem:
    """One problem; key: the image's; what: the wrong value and the expected one."""

    shard: Path
    key: str
    what: str

    def __str__(self) -> str:
        return f"{self.shard}: {self.key}: {self.what}"


@dataclass(frozen=True)
class CheckedShard:
    """The readable images of a shard, and its problems."""

    path: Path
    images: tuple[CheckedImage, ...]
    problems: tuple[Problem, ...]


def check_sets(expected: Mapping[str, ExpectedSet], workers: int) -> dict[str, list[CheckedImage]]:
    """Check sets in `workers` processes; returns all images by set, in key order.

    Raises InputError if any set has a problem, after logging the first 20.
    """
    jobs = [(which, name) for which in expected.values() for name in which.shards]
    counts = [len(which.shards[name]) for which, name in jobs]
    # Spawned, not forked: a fork of a process with threads, such as those of BLAS, may hang.
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
    with pool, tqdm(total=sum(counts), desc="checking", unit="image", disable=None) as bar:
        checked = []
        results = pool.map(check_shard, *zip(*jobs, strict=True))
        for count, shard in zip(counts, results, strict=True):
            checked.append(shard)
            bar.update(count)
    refuse(find_problems(expected.values(), checked))
    return {
        name: [i for shard in checked if shard.path.parent == which.folder for i in shard.images]
        for name, which in expected.items()
    }


def check_shard(expected: ExpectedSet, name: str) -> CheckedShard:
    """Check the shard `name` of a set and each of its images."""
    path = expected.folder / name
    numbers = {sample_key(number): number for number in expected.shards[name]}
    keys = list(numbers)
    if not path.is_file() or not is_whole(path):
        state = "truncated or damaged" if path.is_file() else "missing"
        return CheckedShard(path, (), (Problem(path, f"{keys[0]} to {keys[-1]}", state),))
    members = read_members(path)
    problems = [Problem(path, key, "missing") for key in keys if key not in members]
    problems += [
        Problem(path, key, f"not one of this shard's images, {keys[0]} to {keys[-1]}")
        for key in members
        if key not in keys
    ]
    images = []
    for key in filter(members.__contains__, keys):
        image, found = _check_member(expected, key, members[key], numbers[key])
        images += [image] if image else []
        problems += [Problem(path, key, what) for what in found]
    return CheckedShard(path, tuple(images), tuple(problems))


def _check_member(
    expected: ExpectedSet, key: str, members: Mapping[str, bytes], number: int
) -> tuple[CheckedImage | None, list[str]]:
    """Check one image, and that it belongs to its set: see `check_image`."""
    image, found = check_image(key, members, expected.settings, expected.body, expected.backgrounds)
    if image:
        own = (("seed", image.seed, expected.seed), ("index", image.index, number))
        found += [
            f"{what} = {value}: expected {right}" for what, value, right in own if value != right
        ]
    return image, found


def read_members(path: Path) -> dict[str, dict[str, bytes]]:
    """All members of a complete shard: key -> suffix -> bytes."""
    members: dict[str, dict[str, bytes]] = {}
    with tarfile.open(path, "r:") as tar:
        for entry in tar:
            key, _, suffix = entry.name.partition(".")
            file = tar.extractfile(entry)
            if file is not None:
                members.setdefault(key, {})[suffix] = file.read()
    return members


def find_problems(
    expected: Iterable[ExpectedSet], checked: Sequence[CheckedShard]
) -> list[Problem]:
    """All problems of checked sets: in their shards, stray shards, and duplicates."""
    found = [problem for shard in checked for problem in shard.problems]
    strays = [problem for which in expected for problem in stray_shards(which)]
    return [*found, *strays, *duplicates(checked)]


def stray_shards(expected: ExpectedSet) -> list[Problem]:
    """Shard files that do not belong to the set; training would read them too."""
    found = sorted(expected.folder.glob("shard-*.tar"))
    strays = (path for path in found if path.name not in expected.shards)
    return [Problem(path, "all", "not a shard of this set") for path in strays]


def duplicates(checked: Iterable[CheckedShard]) -> Iterator[Problem]:
    """Image files and poses that occurred before.

    Images without a shaft may repeat: they show a background only.
    """
    seen: dict[object, str] = {}
    for shard in checked:
        for image in shard.images:
            here = f"{shard.path}: {image.key}"
            names = {image.digest: "image file"} if image.shafts else {}
            names |= {_pose(shaft): "pose" for shaft in image.shafts}
            for value, what in names.items():
                first = seen.setdefault(value, here)
                if first != here:
                    yield Problem(shard.path, image.key, f"the same {what} as {first}")


def refuse(problems: Sequence[Problem]) -> None:
    """Raise InputError naming the first problem, if there are any; log the first 20."""
    if not problems:
        return
    for problem in problems[:MOST_NAMED]:
        logger.error("%s", problem)
    if len(problems) > MOST_NAMED:
        logger.error("and %d more", len(problems) - MOST_NAMED)
    remedy = rerender(problem.shard for problem in problems[:MOST_NAMED])
    raise InputError(f"{problems[0]} (problem 1 of {len(problems)}); {remedy}")
