"""`shaftpose real fetch`, from repositories on this machine."""

import csv
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from shaftpose.cli import real
from shaftpose.cli.main import main
from shaftpose.cli.real import FRAMES, REPOSITORIES, Repository, fetch
from shaftpose.core.errors import InputError
from shaftpose.core.images import read_rgb, write_jpeg
from shaftpose.dataset.coco import check_masks, read_coco
from shaftpose.dataset.coco_images import load_square

PARTS = ("train", "test")
ANNOTATIONS = Path(__file__).parents[2] / "src/shaftpose/cli/real_images"


def repository(folder: Path, names: list[str]) -> Repository:
    """A repository in which all files are the same picture, bright in columns 300 to 1000."""
    rgb = np.zeros((720, 1280, 3), dtype=np.uint8)
    rgb[:, 300:1000] = 200
    write_jpeg(rgb, folder / "picture.jpg")
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(folder / "picture.jpg", folder / name)
    git = ["git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@example.org"]
    for arguments in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "pictures"]):
        subprocess.run([*git, *arguments], check=True)
    head = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True)
    return Repository(f"file://{folder}", head.stdout.strip(), "CC0")


@pytest.fixture(scope="module")
def repositories(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Repository]:
    parts = [json.loads((ANNOTATIONS / f"{part}.json").read_text()) for part in PARTS]
    frames = [image["file_name"] for part in parts for image in part["images"]]
    with (ANNOTATIONS / "backgrounds.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    wanted = {
        name: [row["file"] for row in rows if row["repository"] == name] for name in REPOSITORIES
    }
    wanted[FRAMES] += frames
    folder = tmp_path_factory.mktemp("sources")
    return {name: repository(folder / name, files) for name, files in wanted.items()}


def test_annotations_and_images_are_joined(
    repositories: dict[str, Repository], tmp_path: Path
) -> None:
    out = tmp_path / "endoscopic"
    fetch(out, repositories)
    train, test = (read_coco(out / f"{part}.json") for part in PARTS)
    check_masks([*train, *test], out)
    assert (len(train), len(test)) == (53, 36)
    assert [sum(len(image.instruments) for image in part) for part in (train, test)] == [84, 53]
    operations = [{image.path.name[:5] for image in part} for part in (train, test)]
    assert not operations[0] & operations[1]
    axes = np.concatenate([load_square(image, 299).axes for image in test])
    assert np.isfinite(axes).all()
    for source in repositories.values():
        assert source.commit in (out / "SOURCES.txt").read_text()


def test_the_command_says_how_to_use_the_images(
    repositories: dict[str, Repository],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(real, "REPOSITORIES", repositories)
    main(["real", "fetch", str(tmp_path)])
    assert f"real.source: {tmp_path}\n" in capsys.readouterr().out
    assert len(read_coco(tmp_path / "train.json")) == 53


def test_backgrounds_are_squares_of_no_operation_of_the_tests(
    repositories: dict[str, Repository], tmp_path: Path
) -> None:
    fetch(tmp_path, repositories)
    squares = sorted((tmp_path / "backgrounds").rglob("*.jpg"))
    assert len(squares) == 31
    tested = {image.path.name[:5] for image in read_coco(tmp_path / "test.json")}
    assert not {square.parent.name.rpartition("-")[2] for square in squares} & tested
    frames = [square for square in squares if square.parent.name.startswith(FRAMES)]
    for square in frames:
        rgb = read_rgb(square)
        assert rgb.shape == (512, 512, 3)
        assert rgb.mean() > 180  # of the picture's bright columns


def test_annotations_are_not_replaced(repositories: dict[str, Repository], tmp_path: Path) -> None:
    mine = tmp_path / "test.json"
    mine.write_text("mine")
    with pytest.raises(InputError, match=r"test\.json: would be replaced; name a new folder"):
        fetch(tmp_path, repositories)
    assert mine.read_text() == "mine"


def test_a_failed_download_is_one_error(
    repositories: dict[str, Repository], tmp_path: Path
) -> None:
    missing = repositories | {FRAMES: Repository(f"file://{tmp_path}/nowhere", "0" * 40, "CC0")}
    with pytest.raises(InputError, match=r"git: .*nowhere.*; check the connection"):
        fetch(tmp_path / "out", missing)
