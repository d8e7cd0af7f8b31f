"""Bundle the model of a finished training with the package.

`python -m studies.bundle_model FOLDER` takes a training that `studies.evaluate_trainings` has
evaluated on the images in data/; for the pipeline's variant e: `models/e --results
data/results/e`. It stores the model in half the bytes, compares both files on the test images, and
writes src/shaftpose/models/ (model, checksum, card) and tests/data/bundled_model/ (three test
images, and bounds for the model's errors on them).
"""

import argparse
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import onnx

from shaftpose.core.markdown import pipe_table
from shaftpose.core.shards import ShardedDataset
from shaftpose.core.split_lists import read_keys
from shaftpose.deployment.bundled import CHECKSUM, MODEL, checksum
from shaftpose.deployment.half_weights import with_half_weights
from shaftpose.deployment.predictor import Predictor
from shaftpose.errors import InputError, exit_on_input_error
from shaftpose.evaluation.metrics import Metrics
from shaftpose.evaluation.results import Evaluation
from shaftpose.handovers import read_handover
from shaftpose.report.report_tables import TABLE_I_METRICS, cells
from shaftpose.report.writing import with_fits
from shaftpose.training.data_identity import rendered_digest
from studies.evaluate_trainings import check, finished
from studies.model_comparison import Comparison, compare
from studies.model_frames import complaints, write_frames
from studies.templates import rendered

ROOT = Path(__file__).parents[1]
MODELS, FRAMES = Path("src/shaftpose/models"), Path("tests/data/bundled_model")
CARD = "shaftpose.md"
MOST_BYTES = 8_000_000
SAME_MAP = 1e-3  # rounding causes smaller differences


def main() -> None:
    """Bundle the training of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of an exported and evaluated training")
    parser.add_argument("--results", type=Path, help="folder of evaluation.json (default: FOLDER)")
    arguments = parser.parse_args()
    with exit_on_input_error():
        bundle(arguments.folder, arguments.results or arguments.folder, ROOT)


def bundle(folder: Path, results: Path, root: Path) -> None:
    """Write the training's model, its card and its frames below `root`.

    Raises InputError, and writes nothing, if the training is not finished and evaluated, or its
    model is too large or loses too much.
    """
    check(folder, rendered_digest())
    result, exported = evaluated(folder, results), Predictor(folder / "model.onnx")
    shards, keys = ShardedDataset(Path("data/render/images")), read_keys(Path("data/split"), "test")
    with TemporaryDirectory() as scratch:
        models, frames = Path(scratch) / MODELS, Path(scratch) / FRAMES
        stored = Predictor(store(folder / "model.onnx", models))
        comparison = compare(exported, stored, shards, keys)
        print(comparison)
        refuse_another(folder, result, comparison.exported)
        write_frames(frames, shards, keys, exported)
        if (worse := complaints(stored, frames)) or not comparison.holds:
            what = "; ".join([str(comparison), *worse])
            raise InputError(f"{folder}/model.onnx: loses too much in 16 bits: {what}")
        source = shards.facts(keys[0])["source"]
        (models / CARD).write_text(card(result, stored, comparison, source))
        for part in (MODELS, FRAMES):
            shutil.rmtree(root / part, ignore_errors=True)
            shutil.copytree(Path(scratch) / part, root / part)
    print(f"written to {MODELS} and {FRAMES}")


def evaluated(folder: Path, results: Path) -> Evaluation:
    """The recorded evaluation of the folder's training, of fitted poses if it has them.

    Raises InputError if there are none.
    """
    path, remedy = (
        results / "evaluation.json",
        f"run `python -m studies.evaluate_trainings {folder}`",
    )
    found = read_handover(path, Evaluation, f"{remedy}, or name its folder by --results")
    if found.training.training_id != finished(folder).training_id:
        raise InputError(f"{path}: belongs to another training than {folder}; {remedy}")
    *_, as_used = with_fits({"": found}).values()
    return as_used


def store(exported: Path, folder: Path) -> Path:
    """Write the model in half the bytes, and its checksum. Raises InputError if it is too large."""
    folder.mkdir(parents=True)
    path = folder / MODEL
    onnx.save(with_half_weights(onnx.load(str(exported))), str(path))
    if path.stat().st_size > MOST_BYTES:
        raise InputError(
            f"{exported}: takes {path.stat().st_size:,} bytes with weights of 16 bits, more than "
            f"the limit of {MOST_BYTES:,}; bundle a narrower network"
        )
    (folder / CHECKSUM).write_bytes(checksum(path))
    return path


def refuse_another(folder: Path, recorded: Evaluation, measured: Metrics) -> None:
    """Raise InputError unless the recorded results are those of the folder's model."""
    now, then = measured.mAP or 0.0, recorded.accuracy.metrics.mAP or 0.0
    if abs(now - then) > SAME_MAP:
        raise InputError(
            f"{folder}/model.onnx: has a mAP of {now:.3f}, but {then:.3f} was recorded; run "
            "`python -m studies.evaluate_trainings` again"
        )


def card(evaluation: Evaluation, stored: Predictor, comparison: Comparison, source: str) -> str:
    """The model card as Markdown; `source` is the id of a background of the test images."""
    columns = tuple(column for column in TABLE_I_METRICS if column.name != "fps")
    files = {"exported": comparison.exported, "bundled": comparison.stored}
    return rendered(
        "model_card.md.j2",
        file=MODEL,
        title=evaluation.title,
        training=evaluation.training,
        predictor=stored,
        comparison=comparison,
        tissue=source.startswith("tissue-"),
        errors=pipe_table(
            ["File", *(column.heading for column in columns)],
            [[name, *cells(metrics.as_dict(), columns)] for name, metrics in files.items()],
        ),
    )


if __name__ == "__main__":
    main()
