"""Make the model of a finished training the one that comes with the package.

`python tools/bundle_model.py FOLDER` takes a training that `tools/evaluate_trainings.py` has
evaluated on the images in data/; of the pipeline's variant d that is `models/d --results
data/results/d`. It stores the model in half the bytes, compares both files on the test images, and
writes src/shaftpose/models/ (model, checksum, card) and tests/data/bundled_model/ (three test
images, and bounds for the model's errors on them).
"""

import argparse
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import onnx
from jinja2 import Environment, StrictUndefined

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "pipelines"), str(ROOT / "tools")]

from digests import rendered_digest  # noqa: E402
from evaluate_trainings import check, noted  # noqa: E402
from model_comparison import Comparison, compare  # noqa: E402
from model_frames import complaints, write_frames  # noqa: E402
from results import read_json  # noqa: E402

from shaftpose.dataset.split import read_keys  # noqa: E402
from shaftpose.deployment.bundled import CHECKSUM, MODEL, checksum  # noqa: E402
from shaftpose.deployment.half_weights import with_half_weights  # noqa: E402
from shaftpose.deployment.predictor import Predictor  # noqa: E402
from shaftpose.errors import InputError  # noqa: E402
from shaftpose.evaluation.metrics import Metrics  # noqa: E402
from shaftpose.evaluation.report import pipe_table  # noqa: E402
from shaftpose.evaluation.report_tables import TABLE_I_METRICS, cells  # noqa: E402
from shaftpose.evaluation.training_record import whole  # noqa: E402
from shaftpose.shards import ShardedDataset  # noqa: E402

MODELS, FRAMES = Path("src/shaftpose/models"), Path("tests/data/bundled_model")
CARD, TEMPLATE = "shaftpose.md", Path(__file__).with_name("model_card.md.j2")
MOST_BYTES = 8_000_000
SAME_MAP = 1e-3  # rounding changes less


def main() -> None:
    """Bundle the training of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="of a finished, exported and evaluated training")
    parser.add_argument("--results", type=Path, help="folder of evaluation.json (the training's)")
    arguments = parser.parse_args()
    try:
        bundle(arguments.folder, arguments.results or arguments.folder, ROOT)
    except InputError as error:
        sys.exit(f"error: {error}")


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


def evaluated(folder: Path, results: Path) -> Mapping[str, Any]:
    """What was recorded of the folder's training. Raises InputError unless it was evaluated."""
    path, remedy = results / "evaluation.json", f"run `python tools/evaluate_trainings.py {folder}`"
    result: Mapping[str, Any] = read_json(path, f"{remedy}, or name its folder by --results")
    with whole(str(path), remedy):
        if result["training"]["training_id"] != noted(folder)["training_id"]:
            raise InputError(f"{path}: is of another training than {folder}; {remedy}")
    return result


def store(exported: Path, folder: Path) -> Path:
    """Write the model in half the bytes, and its checksum. Raises InputError if it is too large."""
    folder.mkdir(parents=True)
    path = folder / MODEL
    onnx.save(with_half_weights(onnx.load(str(exported))), str(path))
    if path.stat().st_size > MOST_BYTES:
        raise InputError(
            f"{exported}: takes {path.stat().st_size:,} bytes with weights of 16 bits, more than "
            f"the {MOST_BYTES:,} that the package may; bundle a narrower network"
        )
    (folder / CHECKSUM).write_bytes(checksum(path))
    return path


def refuse_another(folder: Path, result: Mapping[str, Any], measured: Metrics) -> None:
    """Raise InputError unless the recorded results are those of the folder's model."""
    now, then = measured.mAP or 0.0, result["metrics"]["mAP"] or 0.0
    if abs(now - then) > SAME_MAP:
        raise InputError(
            f"{folder}/model.onnx: has a mAP of {now:.3f}, but {then:.3f} was recorded; run "
            "`tools/evaluate_trainings.py` again"
        )


def card(result: Mapping[str, Any], stored: Predictor, comparison: Comparison, source: str) -> str:
    """The model card as Markdown; `source` is the id of a background of the test images."""
    columns = tuple(column for column in TABLE_I_METRICS if column.name != "fps")
    files = {"exported": comparison.exported, "bundled": comparison.stored}
    environment = Environment(
        undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    return environment.from_string(TEMPLATE.read_text()).render(
        file=MODEL,
        title=result["title"],
        training=result["training"],
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
