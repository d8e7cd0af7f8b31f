"""Small rendered sets for tests: masks of exact cylinders, pictures of noise."""

import io
import json
import tarfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from shaftpose.checks.expected_sets import Body, ExpectedSet
from shaftpose.checks.set_checks import CheckedShard, check_shard
from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter, shard_name
from shaftpose.settings.parsing import parse
from shaftpose.settings.schema import RenderSettings

ROOT = Path(__file__).parents[2]
SIDE = 299
CAMERA = Camera.from_field_of_view(SIDE, SIDE, 95.0)
ROD = Body(diameter_mm=3.0, length_mm=150.0, is_rod=True)
SEED = 7
BACKGROUNDS = {"000000.jpg": "tissue-0", "000001.jpg": "tissue-1"}
LEFT = ShaftPose(-6.0, -3.0, 25.0, 70.0, 150.0)
RIGHT = ShaftPose(7.0, 4.0, 30.0, 60.0, 340.0)
ABOVE = ShaftPose(1.0, -8.0, 20.0, 80.0, 270.0)
BELOW = ShaftPose(-2.0, 9.0, 35.0, 55.0, 100.0)


def settings() -> RenderSettings:
    """The repository's own settings."""
    values = yaml.safe_load((ROOT / "params.yaml").read_text())
    parts = {name: values[name] for name in ("camera", "poses", "shaft", "scene", "lens")}
    return parse(RenderSettings, {**parts, "samples": (2, 4), "jpeg_quality": 95}, "params.yaml: ")


def silhouettes(poses: Sequence[ShaftPose], camera: Camera = CAMERA) -> list[NDArray[np.bool_]]:
    """The visible mask of each shaft; nearer shafts hide those behind."""
    depths = np.stack([cylinder_depth(camera, pose, 3.0, 150.0) for pose in poses])
    return [(np.argmin(depths, axis=0) == n) & np.isfinite(d) for n, d in enumerate(depths)]


def instrument(pose: ShaftPose, mask: NDArray[np.bool_], camera: Camera = CAMERA) -> Instrument:
    """A shaft with the visible mask `mask`."""
    return Instrument(pose, mask, np.isfinite(cylinder_depth(camera, pose, 3.0, 150.0)) | mask)


def sample(
    index: int,
    poses: Sequence[ShaftPose],
    masks: Sequence[NDArray[np.bool_]] | None = None,
    look: int | None = None,
    camera: Camera = CAMERA,
    **described: Any,
) -> Sample:
    """Image `index`; masks: the shafts' silhouettes by default; look: seed of the pixels."""
    cells = np.random.default_rng(index if look is None else look).integers(
        0, 256, (13, 13, 3), dtype=np.uint8
    )
    shown = masks if masks is not None else silhouettes(poses, camera) if poses else []
    return Sample(
        key=sample_key(index),
        rgb=cells.repeat(23, axis=0).repeat(23, axis=1),
        instruments=tuple(instrument(p, m, camera) for p, m in zip(poses, shown, strict=True)),
        camera=camera,
        scene_description={
            "background": f"{index % 2:06d}.jpg",
            "source": f"tissue-{index % 2}",
            "seed": SEED,
            "index": index,
            "light": {"strength": 1000.0 + index, "kelvin": 5000.0, "ambient": 1.0},
            "steels": [
                {"grey": 0.6, "roughness": 0.2 + 0.1 * n, "scratches": 0.1, "grain": 1.0}
                for n in range(len(poses))
            ],
            "occluders": [],
            "tries": 4 * max(len(poses), 1),
            "samples": 3,
        }
        | described,
    )


def write_set(folder: Path, shards: Sequence[Sequence[Sample]]) -> ExpectedSet:
    """Write samples, shard by shard; returns the set that matches them."""
    for number, samples in enumerate(shards):
        with ShardWriter(folder / shard_name(number), 95) as writer:
            for one in samples:
                writer.write(one)
    starts = np.cumsum([0, *(len(samples) for samples in shards)]).tolist()
    ranges = {shard_name(n): range(starts[n], starts[n + 1]) for n in range(len(shards))}
    return ExpectedSet(folder, settings(), ROD, SEED, ranges, BACKGROUNDS)


def checked(expected: ExpectedSet) -> list[CheckedShard]:
    """All shards of a set, checked in this process."""
    return [check_shard(expected, name) for name in expected.shards]


def rewrite(path: Path, edit: Callable[[dict[str, bytes]], Any]) -> None:
    """Change a shard's members, name -> bytes, and write a complete shard."""
    with tarfile.open(path) as tar:
        members = {entry.name: read(tar, entry) for entry in tar}
    edit(members)
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
        for name, data in members.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            tar.addfile(entry, io.BytesIO(data))


def read(tar: tarfile.TarFile, entry: tarfile.TarInfo) -> bytes:
    file = tar.extractfile(entry)
    assert file is not None
    return file.read()


def edit_json(name: str, edit: Callable[[Any], Any]) -> Callable[[dict[str, bytes]], None]:
    """An edit of a shard that changes the content of one JSON member in place."""

    def edit_members(members: dict[str, bytes]) -> None:
        content = json.loads(members[name])
        edit(content)
        members[name] = json.dumps(content).encode()

    return edit_members


def first(content: Sequence[dict[str, Any]], **values: Any) -> None:
    """Change values of the first entry of a list."""
    content[0].update(values)
