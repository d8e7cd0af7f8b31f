"""Bundle the model of a finished training with the package, by a name.

`python -m studies.bundle_model FOLDER` takes a training that `studies.evaluate_trainings` has
evaluated on the images in data/; for the pipeline's variant e: `models/e --results
data/results/e`. It stores the model in half the bytes, compares both files on the test images, and
writes it to src/shaftpose/models/, with checksum and card, and three test images with bounds for
the model's errors on them to tests/data/bundled_models/. If the backgrounds come from a folder,
these images are not written: the backgrounds belong to others.
"""

import argparse
import shutil
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import onnx

from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.split import read_keys
from shaftpose.evaluation.results import Evaluation
from shaftpose.export.compression import with_half_weights
from shaftpose.figures.markdown import pipe_table
from shaftpose.inference.model_files import (
    CARD_SUFFIX,
    CHECKSUM_SUFFIX,
    DEFAULT,
    ModelMetadata,
    checksum,
)
from shaftpose.inference.predictor import Predictor
from shaftpose.metrics.table import MetricValues
from shaftpose.report.accuracy_tables import ACCURACY
from shaftpose.report.cells import cells, headings
from shaftpose.stage_files import REAL, read_stage_file
from shaftpose.training.fingerprint import rendered_digest
from studies.evaluate_trainings import check, finished
from studies.model_comparison import Comparison, compare
from studies.model_frames import complaints, write_frames
from studies.pages import rendered

ROOT = Path(__file__).parents[1]
MODELS, FRAMES = Path("src/shaftpose/models"), Path("tests/data/bundled_models")
MOST_BYTES = 8_000_000  # of all bundled models
SAME_MAP = 1e-3  # rounding causes smaller differences


def main() -> None:
    """Bundle the training of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of an exported and evaluated training")
    parser.add_argument("--results", type=Path, help="folder of evaluation.json (default: FOLDER)")
    parser.add_argument("--name", default=DEFAULT, help=f"of the model ({DEFAULT})")
    parser.add_argument("--notice", type=Path, help="text file on the origin of its images")
    arguments = parser.parse_args()
    with exit_on_input_error():
        folder, file = arguments.folder, arguments.notice
        if file and not file.is_file():
            raise InputError(
                f"{file}: is no file; `shaftpose real fetch FOLDER` writes SOURCES.txt"
            )
        notice = file.read_text() if file else ""
        bundle(folder, arguments.results or folder, ROOT, arguments.name, notice)


def bundle(folder: Path, results: Path, root: Path, name: str = DEFAULT, notice: str = "") -> None:
    """Write the training's model, its card and its frames below `root`; notice: for the card.

    Raises InputError, and writes nothing, if the training is not finished and evaluated, or its
    model is too large or loses too much.
    """
    images, split = Path("data/render/images"), Path("data/split")
    check(folder, rendered_digest(images, split))
    result, exported = evaluated(folder, results), Predictor(folder / "model.onnx")
    shards, keys = ShardedDataset(images), read_keys(split, "test")
    with TemporaryDirectory() as scratch:
        models, frames = Path(scratch) / MODELS, Path(scratch) / FRAMES / name
        stored = Predictor(store(folder / "model.onnx", models, name))
        refuse_too_large(models, root / MODELS)
        comparison = compare(exported, stored, shards, keys)
        print(comparison)
        refuse_another(folder, result, comparison.exported)
        write_frames(frames, shards, keys, exported)
        procedural = str(shards.scene_description(keys[0])["source"]).startswith("tissue-")
        if (worse := complaints(stored, frames)) or not comparison.holds:
            what = "; ".join([str(comparison), *worse])
            raise InputError(f"{folder}/model.onnx: loses too much in 16 bits: {what}")
        text = card(name, result, stored, comparison, procedural, notice)
        (models / f"{name}{CARD_SUFFIX}").write_text(text)
        shutil.copytree(models, root / MODELS, dirs_exist_ok=True)
        shutil.rmtree(root / FRAMES / name, ignore_errors=True)
        if procedural:
            shutil.copytree(frames, root / FRAMES / name)
    print(f"{name}: written to {MODELS}" + (f" and {FRAMES / name}" if procedural else ""))


def evaluated(folder: Path, results: Path) -> Evaluation:
    """The recorded evaluation of the folder's training. Raises InputError if there is none."""
    path, remedy = (
        results / "evaluation.json",
        f"run `python -m studies.evaluate_trainings {folder}`",
    )
    found = read_stage_file(path, Evaluation, f"{remedy}, or name its folder by --results")
    if found.training.training_id != finished(folder).training_id:
        raise InputError(f"{path}: belongs to another training than {folder}; {remedy}")
    return found


def store(exported: Path, folder: Path, name: str) -> Path:
    """Write the model in half the bytes, and its checksum; returns the model's file."""
    folder.mkdir(parents=True)
    path = folder / f"{name}.onnx"
    model = with_half_weights(onnx.load(str(exported)))
    metadata = ModelMetadata.from_text({entry.key: entry.value for entry in model.metadata_props})
    if metadata.edge_reader is not None:
        reader = with_half_weights(onnx.ModelProto.FromString(metadata.edge_reader))
        metadata = replace(metadata, edge_reader=reader.SerializeToString())
    onnx.helper.set_model_props(model, metadata.as_text())
    onnx.save(model, str(path))
    (folder / f"{name}{CHECKSUM_SUFFIX}").write_bytes(checksum(path))
    return path


def refuse_too_large(new: Path, bundled: Path) -> None:
    """Raise InputError if the models in both folders are too large together; those in `new` replace
    others of their name."""
    files = {path.name: path for folder in (bundled, new) for path in folder.glob("*.onnx")}
    taken = sum(path.stat().st_size for path in files.values())
    if taken > MOST_BYTES:
        raise InputError(
            f"{', '.join(sorted(files))}: take {taken:,} bytes with weights of 16 bits, more than "
            f"the limit of {MOST_BYTES:,}; bundle a narrower network"
        )


def refuse_another(folder: Path, recorded: Evaluation, measured: MetricValues) -> None:
    """Raise InputError unless the recorded results are those of the folder's model, as the package
    runs it."""
    if recorded.refined and recorded.detection["refine"] == "views":
        raise InputError(f"{folder}: was evaluated with detection.refine = views: leave that out")
    now = measured["mAP"] or 0.0
    then = (recorded.refined or recorded.raw).metrics["mAP"] or 0.0
    if abs(now - then) > SAME_MAP:
        raise InputError(
            f"{folder}/model.onnx: has a mAP of {now:.3f}, but {then:.3f} was recorded; run "
            "`python -m studies.evaluate_trainings` again"
        )


def card(
    name: str,
    evaluation: Evaluation,
    stored: Predictor,
    comparison: Comparison,
    procedural: bool,
    notice: str,
) -> str:
    """The model card as Markdown; procedural: whether the backgrounds are."""
    mixed_in = evaluation.training.data.mixed_in
    files = {"exported": comparison.exported, "bundled": comparison.stored}
    return rendered(
        "model_card.md.j2",
        name=name,
        default=DEFAULT,
        title=f"{evaluation.title} + fit" if evaluation.refined else evaluation.title,
        training=evaluation.training,
        predictor=stored,
        comparison=comparison,
        tissue=procedural,
        notice=notice.strip(),
        real=mixed_in is not None and mixed_in.domain == REAL,
        errors=pipe_table(
            ["File", *headings(ACCURACY)],
            [[name, *cells(metrics, ACCURACY)] for name, metrics in files.items()],
        ),
    )


if __name__ == "__main__":
    main()
