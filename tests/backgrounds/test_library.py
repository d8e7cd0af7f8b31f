import csv
import logging
from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.backgrounds.library import (
    decoded_images,
    image_files,
    procedural_sources,
    write_library,
)
from shaftpose.backgrounds.tissue import MUCOSA
from shaftpose.backgrounds.variations import VariationRanges
from shaftpose.core.background_index import Background, read_library
from shaftpose.core.errors import InputError
from shaftpose.core.images import centre_square

RANGES = VariationRanges(hue_deg=(-10, 10), saturation=(0.8, 1.2), brightness=(0.6, 0.8))
RED = np.full((20, 30, 3), (200, 40, 30), dtype=np.uint8)


def save(path: Path, image: np.ndarray = RED) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image[..., ::-1])
    return path


def sources(count: int) -> list[tuple[str, np.ndarray]]:
    rng = np.random.default_rng(0)
    return [(f"s{k}", rng.integers(0, 256, (12, 16, 3), dtype=np.uint8)) for k in range(count)]


def test_source_images_are_found_sorted_and_rgb(tmp_path: Path) -> None:
    save(tmp_path / "b.PNG")
    save(tmp_path / "a" / "z.jpeg")
    save(tmp_path / "a" / "c.TIFF")
    save(tmp_path / "a" / "d.webp").rename(tmp_path / "a" / "d")  # known by its content
    (tmp_path / "notes.txt").write_text("no image")
    found = list(decoded_images(tmp_path, image_files(tmp_path)))
    # Frames of one operation, in one subfolder, are one source.
    assert [source for source, _ in found] == ["a", "a", "a", "b.PNG"]
    assert found[3][1][0, 0].tolist() == [200, 40, 30]


def test_a_corrupt_file_is_skipped_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    save(tmp_path / "good.png")
    (tmp_path / "bad.jpg").write_bytes(b"not a jpeg")
    (tmp_path / "empty.jpg").touch()
    with caplog.at_level(logging.WARNING):
        images = list(decoded_images(tmp_path, image_files(tmp_path)))
    assert [source for source, _ in images] == ["good.png"]
    assert f"skipped {tmp_path / 'bad.jpg'}: not a readable image" in caplog.text
    assert f"skipped {tmp_path / 'empty.jpg'}: not a readable image" in caplog.text


def test_a_file_that_may_not_be_read_is_skipped_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(tmp_path / "good.png")
    secret, read_bytes = save(tmp_path / "secret.png"), Path.read_bytes

    def refuse(path: Path) -> bytes:
        if path == secret:
            raise PermissionError(13, "Permission denied", str(path))
        return read_bytes(path)

    # root can read any file, so its mode has no effect.
    monkeypatch.setattr(Path, "read_bytes", refuse)
    with caplog.at_level(logging.WARNING):
        images = list(decoded_images(tmp_path, image_files(tmp_path)))
    assert [source for source, _ in images] == ["good.png"]
    assert f"skipped {secret}: cannot be read (Permission denied)" in caplog.text


def test_a_folder_without_one_good_image_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "bad.jpg").write_bytes(b"not a jpeg")
    with pytest.raises(InputError, match="decoded") as error:
        list(decoded_images(tmp_path, image_files(tmp_path)))
    assert str(tmp_path) in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("name, remedy", [("absent", "create it"), (".", "add PNG")])
def test_missing_and_empty_folders_are_errors(tmp_path: Path, name: str, remedy: str) -> None:
    with pytest.raises(InputError, match=remedy) as error:
        image_files(tmp_path / name)
    assert str(tmp_path / name) in str(error.value)


def test_centre_square_takes_the_centre() -> None:
    image = np.zeros((10, 30, 3), dtype=np.uint8)
    image[:, 10:20] = 255
    assert np.all(centre_square(image, 5) == 255)
    assert centre_square(image, 25).shape == (25, 25, 3)


def test_procedural_image_k_depends_on_seed_and_k_only() -> None:
    few, many = (list(procedural_sources(n, 5, 48, MUCOSA)) for n in (2, 4))
    assert [source for source, _ in many][2:] == ["tissue-000002", "tissue-000003"]
    assert all(np.array_equal(a[1], b[1]) for a, b in zip(few, many, strict=False))
    ((_, other),) = procedural_sources(1, 6, 48, MUCOSA)
    assert not np.array_equal(other, many[0][1])


def test_a_library_reads_back_as_it_was_written(tmp_path: Path) -> None:
    write_library(sources(2), tmp_path, 3, RANGES, seed=1, size_px=8, total=1)
    assert read_library(tmp_path) == [
        Background(tmp_path / f"{k:06d}.jpg", f"s{k // 3}") for k in range(6)
    ]


def test_the_first_of_each_source_is_unaltered_and_the_rest_are_in_range(tmp_path: Path) -> None:
    write_library([("red", RED)], tmp_path, 3, RANGES, seed=1, size_px=8, total=1)
    with (tmp_path / "index.csv").open() as stream:
        first, *rest = csv.DictReader(stream)
    assert (first["hue_deg"], first["saturation"], first["brightness"]) == (
        "0.0000", "1.0000", "1.0000",
    )  # fmt: skip
    original = cv2.imread(str(tmp_path / first["file"]))[..., ::-1]
    assert np.abs(original.astype(int) - (200, 40, 30)).max() <= 3
    for row in rest:
        brightness = float(row["brightness"])
        assert 0.6 <= brightness <= 0.8 and -10 <= float(row["hue_deg"]) <= 10
        darker = cv2.imread(str(tmp_path / row["file"]))
        assert darker.max(axis=-1).mean() == pytest.approx(200 * brightness, abs=4)


def test_bytes_are_reproducible_and_do_not_depend_on_later_sources(tmp_path: Path) -> None:
    write_library(sources(1), tmp_path / "one", 2, RANGES, seed=1, size_px=8, total=1)
    write_library(sources(3), tmp_path / "three", 2, RANGES, seed=1, size_px=8, total=1)
    for name in ("000000.jpg", "000001.jpg"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "three" / name).read_bytes()


def test_the_seed_changes_the_variations(tmp_path: Path) -> None:
    for seed in (1, 2):
        write_library(sources(1), tmp_path / str(seed), 2, RANGES, seed=seed, size_px=8, total=1)
    assert (tmp_path / "1/index.csv").read_text() != (tmp_path / "2/index.csv").read_text()


def test_an_interrupted_library_has_no_index(tmp_path: Path) -> None:
    write_library(sources(1), tmp_path, 1, RANGES, seed=1, size_px=8, total=1)
    images = tmp_path / "images"
    images.mkdir()
    (images / "bad.jpg").write_bytes(b"not a jpeg")
    with pytest.raises(InputError):
        bad = decoded_images(images, image_files(images))
        write_library(bad, tmp_path, 1, RANGES, seed=1, size_px=8, total=1)
    with pytest.raises(InputError, match="index.csv does not exist: run `dvc repro backgrounds`"):
        read_library(tmp_path)


@pytest.mark.parametrize(
    "text, complaint",
    [
        ("", "lacks the columns"),
        ("file,source\n", "lacks the columns"),
        ("file,source,hue_deg,saturation,brightness\n", "lists no backgrounds"),
    ],
)
def test_an_unusable_index_is_an_error(tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / "index.csv").write_text(text)
    with pytest.raises(InputError, match=f"{complaint}.*run `dvc repro backgrounds`") as error:
        read_library(tmp_path)
    assert str(tmp_path / "index.csv") in str(error.value)


def test_a_listed_file_that_is_missing_is_named(tmp_path: Path) -> None:
    write_library(sources(2), tmp_path, 1, RANGES, seed=1, size_px=8, total=1)
    (tmp_path / "000001.jpg").unlink()
    with pytest.raises(InputError, match="000001.jpg.*run `dvc repro backgrounds`"):
        read_library(tmp_path)
