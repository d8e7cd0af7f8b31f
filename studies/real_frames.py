"""Measure a model on whole real frames.

`python -m studies.real_frames --data FOLDER --part validation --model NAME` takes the frames of
`FOLDER/validation.json` from `shaftpose real fetch`. It writes the results to `reports/real` and
draws the worst frames, `reports/real/gallery.jpg`; `make results` shows both in
docs/real_images.md. For frames of your own, name another folder by `--out`. Choices are made by the
validation part. The test part is run once for each model; `reports/real/runs.json` records it. The
part `tissue` are the squares without instruments in `FOLDER/backgrounds`.
"""

import argparse
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np

from shaftpose.cli.real import annotations
from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.files import write_json
from shaftpose.core.images import write_jpeg
from shaftpose.dataset.coco import check_masks, read_coco
from shaftpose.dataset.coco_images import CocoImage
from shaftpose.evaluation.frame_gallery import gallery
from shaftpose.evaluation.frame_results import FrameResults, compared_frames, metrics_by_group
from shaftpose.evaluation.whole_frames import FrameModel
from shaftpose.image_files.reading import read_rgb
from shaftpose.metrics.frames.comparison import ComparedFrame
from shaftpose.origin import origin
from shaftpose.stage_files import read_stage_file
from shaftpose.training.fingerprint import annotated_digest

RECORDS = Path("reports/real")
RUNS, GALLERY = "runs.json", "gallery.jpg"
VALIDATION, TEST, TISSUE = "validation", "test", "tissue"
QUALITY = 80  # of the gallery as JPEG
_REMEDY = "restore it from git"


@dataclass(frozen=True)
class Run:
    """A run on the test part. sha256: of the model's file; digest: of the part."""

    model: str
    sha256: str
    digest: str
    date: str


@dataclass(frozen=True)
class Runs:
    """All runs on the test part, in their order."""

    test: tuple[Run, ...] = ()


def main() -> None:
    """Measure the model of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True, help="of `shaftpose real fetch`")
    parser.add_argument("--part", choices=(VALIDATION, TEST, TISSUE), required=True)
    parser.add_argument("--model", required=True, help="a bundled model's name, or a file")
    parser.add_argument("--out", type=Path, default=RECORDS, help=f"of other frames ({RECORDS})")
    options = parser.parse_args()
    with exit_on_input_error():
        done = measure(options.data, options.part, options.model, options.out)
        print(f"written to {done}")


def measure(data: Path, part: str, name: str, records: Path = RECORDS) -> Path:
    """Measure a model and write its results and the gallery to `records`: the results' file.

    Raises InputError if the results of the model on the same test part, or on other frames, are
    already there.
    """
    images = tissue_squares(data / "backgrounds") if part == TISSUE else _frames(data, part)
    model, digest = FrameModel(name), annotated_digest(images)
    out = records / f"{label(name, model.sha256)}-{part}.json"
    if out.is_file() and read_stage_file(out, FrameResults, _REMEDY).digest != digest:
        raise InputError(
            f"{out}: holds the results of this model on other frames; name another folder by --out"
        )
    if part == TEST and out.is_file():
        raise InputError(
            f"{out}: holds the results of this model on the test part, which is run once; compare "
            "models by --part validation"
        )
    frames = compared_frames(model, images)
    if part == TEST:
        _record(records, Run(name, model.sha256, digest, date.today().isoformat()))
    groups = metrics_by_group(frames, images)
    # Not the folder's path: the digest says which frames these are.
    command = f"python -m studies.real_frames --data FOLDER --part {part} --model {name}"
    made = replace(origin(), command=command)
    results = FrameResults(name, model.sha256, part, digest, model.threshold, groups, made)
    write_json(out, asdict(results))
    if part != TISSUE:
        _draw(model, images, frames, part, records / GALLERY, out.stem)
    return out


def _frames(data: Path, part: str) -> list[CocoImage]:
    path = data / f"{part}.json"
    images = read_coco(path)
    check_masks(images, path)
    return images


def tissue_squares(folder: Path) -> list[CocoImage]:
    """The images of a folder, a folder for each operation, which show no instrument.

    Raises InputError if there is none.
    """
    paths = sorted(folder.glob("*/*.jpg"))
    if not paths:
        raise InputError(f"{folder}: holds no OPERATION/*.jpg; run shaftpose real fetch")
    return [_without_shafts(path) for path in paths]


def _without_shafts(path: Path) -> CocoImage:
    height, width = read_rgb(path).shape[:2]
    return CocoImage(path, width, height, (), operation=path.parent.name)


def label(name: str, sha256: str) -> str:
    """A model's name as part of file names, with the digest of its file."""
    stem = re.sub(r"[^\w-]", "_", Path(name).stem)
    return f"{stem}-{sha256[:8]}"


def runs_of(records: Path) -> Runs:
    """All runs on the test part that a folder records. Raises InputError if the file is damaged."""
    path = records / RUNS
    return read_stage_file(path, Runs, _REMEDY) if path.is_file() else Runs()


def _record(records: Path, run: Run) -> None:
    write_json(records / RUNS, asdict(Runs((*runs_of(records).test, run))))


def _draw(
    model: FrameModel,
    images: Sequence[CocoImage],
    frames: Sequence[ComparedFrame],
    part: str,
    out: Path,
    title: str,
) -> None:
    """Draw the worst of the frames that `shaftpose real fetch` brings: their licences allow it."""
    public = {Path(image["file_name"]).name for image in annotations(f"{part}.json")["images"]}
    shown = np.flatnonzero([image.path.name in public for image in images])
    drawn = gallery(model, [images[n] for n in shown], [frames[n] for n in shown], title)
    if drawn is not None:
        write_jpeg(drawn, out, QUALITY)


if __name__ == "__main__":
    main()
