"""`shaftpose real fetch`, from repositories on this machine."""

import csv
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from shaftpose.cli import real
from shaftpose.cli.main import main
from shaftpose.cli.real import FRAMES, REPOSITORIES, TOOLS, Frame, Repository, annotations, fetch
from shaftpose.core.errors import InputError
from shaftpose.core.images import write_jpeg
from shaftpose.dataset.coco import read_coco
from shaftpose.dataset.coco_folder import read_folder
from shaftpose.dataset.coco_images import load_frame
from shaftpose.image_files.reading import read_rgb

PARTS = ("train", "validation", "test")
ANNOTATIONS = Path(__file__).parents[2] / "src/shaftpose/cli/real_images"
GIT = ["git", "-c", "user.name=a", "-c", "user.email=a@example.org", "-C"]


def repository(
    folder: Path, names: Iterable[str], size: tuple[int, int] = (720, 1280)
) -> Repository:
    """A repository in which all files are the same picture, dark in its left 300 columns.

    size: height and width of the picture, px.
    """
    rgb = np.full((*size, 3), 200, dtype=np.uint8)
    rgb[:, :300] = 0
    write_jpeg(rgb, folder / "picture.jpg")
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(folder / "picture.jpg", folder / name)
    return Repository(f"file://{folder}", commit(folder), "CC0")


def commit(folder: Path) -> str:
    git = [*GIT, str(folder)]
    commands = "init -q", "config uploadpack.allowFilter true", "add .", "commit -q -m pictures"
    for arguments in (command.split() for command in commands):
        subprocess.run([*git, *arguments], check=True)
    head = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True)
    return head.stdout.strip()


@pytest.fixture(scope="module")
def repositories(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Repository]:
    images = [image for part in PARTS for image in annotations(f"{part}.json")["images"]]
    wanted: dict[str, list[str]] = {name: [] for name in REPOSITORIES}
    with (ANNOTATIONS / "backgrounds.csv").open(newline="") as stream:
        for row in csv.DictReader(stream):
            wanted[row["repository"]].append(row["file"])
    wanted[FRAMES] += [image["file_name"] for image in images if "source" not in image]
    prefix = "source_code/model-training-files/datasets/surgical-segmentation-3"
    tools = [f"{prefix}/{image['source']}" for image in images if "source" in image]
    folder = tmp_path_factory.mktemp("sources")
    sources = {name: repository(folder / name, files) for name, files in wanted.items()}
    return sources | {TOOLS: repository(folder / "tools", tools, (640, 640))}


@pytest.fixture(scope="module")
def fetched(repositories: dict[str, Repository], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("endoscopic")
    fetch(out, repositories)
    return out


def test_annotations_and_images_are_joined(
    repositories: dict[str, Repository], fetched: Path
) -> None:
    parts = read_folder(fetched)
    assert {name: len(images) for name, images in parts.items()} == {
        "train": 556, "validation": 110, "test": 161
    }  # fmt: skip
    images = [image for part in parts.values() for image in part]
    shafts = [shaft for image in images for shaft in image.instruments]
    tools = [tool for image in images for tool in image.tools]
    assert (len(shafts), len(tools)) == (84 + 53 + 699, 1247)
    assert sum(tool.shaft_known for tool in tools) == 699 + 75
    assert all(shaft.mask is not None and np.isfinite(shaft.axis).all() for shaft in shafts)
    assert sum(image.field is not None for image in images) == 738
    for image in parts["validation"][::20]:
        assert load_frame(image, 299).instances.any()
    for source in repositories.values():
        assert source.commit in (fetched / "SOURCES.txt").read_text()


def test_no_operation_is_in_two_parts() -> None:
    found: Counter[tuple[str, str]] = Counter()
    for part in PARTS:
        found.update((i["operation"], part) for i in annotations(f"{part}.json")["images"])
    with (ANNOTATIONS / "parts.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert found == {(row["operation"], row["part"]): int(row["images"]) for row in rows}
    assert len({row["operation"] for row in rows}) == len(rows)
    assert all(row["reason"] for row in rows)


def test_every_outlined_shaft_belongs_to_a_tool_of_its_image() -> None:
    for part in PARTS:
        content = annotations(f"{part}.json")
        tools = {a["id"]: a for a in content["annotations"] if a["category_id"] == 2}
        shafts = [a for a in content["annotations"] if "tool" in a["attributes"]]
        assert all(tools[a["attributes"]["tool"]]["image_id"] == a["image_id"] for a in shafts)
        known = {n for n, tool in tools.items() if tool["attributes"]["shaft"] == "outlined"}
        assert known == {a["attributes"]["tool"] for a in shafts}


def test_boxes_and_areas_are_those_of_the_polygons() -> None:
    content = annotations("train.json")
    triangle = real._extent([[0, 0, 10, 0, 0, 4], [20, 1, 22, 1, 22, 3, 20, 3]])
    assert triangle == {"bbox": [0, 0, 22, 4], "area": 10 * 4 / 2 + 2 * 2}
    assert all(a["iscrowd"] == 0 and a["area"] > 0 for a in content["annotations"])


def test_the_command_says_how_to_use_the_images(
    repositories: dict[str, Repository],
    fetched: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(real, "REPOSITORIES", repositories)
    main(["real", "fetch", str(fetched)])
    printed = capsys.readouterr().out
    assert f"{repositories[TOOLS].url}: 0 images to download, 738 are in {fetched}\n" in printed
    assert f"real.source: {fetched}\n" in printed


def test_backgrounds_are_squares_of_no_operation_that_is_measured(fetched: Path) -> None:
    squares = sorted((fetched / "backgrounds").rglob("*.jpg"))
    assert len(squares) == 28
    measured = {image.path.name[:5] for image in read_coco(fetched / "test.json")}
    measured |= {image.path.name[:5] for image in read_coco(fetched / "validation.json")}
    assert not {square.parent.name.rpartition("-")[2] for square in squares} & measured
    frames = [square for square in squares if square.parent.name.startswith(FRAMES)]
    for square in frames:
        rgb = read_rgb(square)
        assert rgb.shape == (512, 512, 3)
        assert rgb.mean() > 180  # of the picture's bright columns


def test_an_interrupted_download_goes_on(tmp_path: Path) -> None:
    """Three pictures of which the folder holds one, and one with other content."""
    source = repository(tmp_path / "source", ["a.jpg", "b.jpg", "c.jpg"], (64, 64))
    out = tmp_path / "out"
    images = [Frame("source", f"{name}.jpg", f"images/{name}.jpg") for name in "abc"]
    real._download(source, images[:1], out)
    kept = (out / "images/a.jpg").stat().st_mtime_ns
    (out / "images/b.jpg").write_bytes(b"cut short")
    real._download(source, images, out)
    assert (out / "images/a.jpg").stat().st_mtime_ns == kept
    picture = (tmp_path / "source/picture.jpg").read_bytes()
    assert all((out / image.target).read_bytes() == picture for image in images)


def test_finished_batches_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The repository lacks the third image, of the second batch."""
    monkeypatch.setattr(real, "_BATCH", 2)
    source = repository(tmp_path / "source", ["a.jpg", "b.jpg"], (64, 64))
    images = [Frame("source", f"{name}.jpg", f"images/{name}.jpg") for name in "abc"]
    with pytest.raises(InputError, match=r"c\.jpg.*again: finished images are kept"):
        real._download(source, images, tmp_path / "out")
    assert {path.name for path in (tmp_path / "out/images").iterdir()} == {"a.jpg", "b.jpg"}


def test_git_has_a_time_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(real, "_GIT_LIMIT_S", 1e-6)
    with pytest.raises(InputError, match="git: not finished after 0 s; check the connection"):
        real._git("-C", str(tmp_path), "status")


def test_annotations_are_not_replaced(repositories: dict[str, Repository], tmp_path: Path) -> None:
    mine = tmp_path / "test.json"
    mine.write_text('"mine"')
    with pytest.raises(InputError, match=r"test\.json: would be replaced; name a new folder"):
        fetch(tmp_path, repositories)
    assert mine.read_text() == '"mine"'


def test_a_failed_download_is_one_error(
    repositories: dict[str, Repository], tmp_path: Path
) -> None:
    missing = repositories | {FRAMES: Repository(f"file://{tmp_path}/nowhere", "0" * 40, "CC0")}
    with pytest.raises(InputError, match=r"git: .*nowhere.*; check the connection"):
        fetch(tmp_path / "out", missing)
