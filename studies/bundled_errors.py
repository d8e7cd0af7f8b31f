"""Measure a bundled model on new renders, for its card and README's table.

`python -m studies.bundled_errors --name shaftpose` takes all images in data/render/images, to be
rendered with the settings of the model's training and another seed. It writes
`reports/bundled/NAME.json` and the errors of the model's card. `make results` shows those of the
default model in README.
"""

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path

from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.files import write_json
from shaftpose.core.shards import ShardedDataset
from shaftpose.figures.markdown import pipe_table
from shaftpose.inference.model_files import CARD_SUFFIX, DEFAULT, FOLDER, bundled_model, checksum
from shaftpose.inference.predictor import Predictor
from shaftpose.inference.shard_prediction import predict_shards
from shaftpose.metrics.metrics import evaluate
from shaftpose.metrics.table import MetricValues
from shaftpose.report.accuracy_tables import ACCURACY
from shaftpose.report.cells import cells, headings, show
from shaftpose.stage_files import read_stage_file
from shaftpose.training.fingerprint import rendered_digest
from studies.pages import rewrite, with_tables

RECORDS, IMAGES, SPLIT = Path("reports/bundled"), Path("data/render/images"), Path("data/split")
COMMAND = "python -m studies.bundled_errors"  # in the markers of the card, by model_card.md.j2


@dataclass(frozen=True)
class BundledErrors:
    """Metrics of a bundled model. model: the line of its checksum."""

    model: str
    metrics: MetricValues


def main() -> None:
    """Measure the model of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--name", default=DEFAULT, help=f"of the bundled model ({DEFAULT})")
    name = parser.parse_args().name
    card = FOLDER / f"{name}{CARD_SUFFIX}"
    with exit_on_input_error():
        check(IMAGES, SPLIT, card)
        metrics = measured(Predictor(bundled_model(name)), IMAGES)
        tables = {"errors": table(metrics)}
        rewrite(card, lambda page: with_tables(page, tables, COMMAND, card.name))
        record = BundledErrors(checksum(bundled_model(name)).decode(), metrics)
        write_json(RECORDS / f"{name}.json", asdict(record))


def check(images: Path, split: Path, card: Path) -> None:
    """Raise InputError if the card says that the model was trained on these images."""
    if split.is_dir() and rendered_digest(images, split) in card.read_text():
        raise InputError(
            f"{images}: the images of the model's training, by {card}; render others, with another "
            "`seed` in params.yaml"
        )


def recorded(root: Path) -> MetricValues:
    """The metrics of the default model.

    Raises InputError if there is no record below `root`, or one of another model.
    """
    remedy = f"run `{COMMAND}`"
    path = root / RECORDS / f"{DEFAULT}.json"
    record = read_stage_file(path, BundledErrors, remedy)
    if record.model.encode() != checksum(bundled_model()):
        raise InputError(f"{path}: measured of another model than the bundled one; {remedy}")
    return record.metrics


def measured(predictor: Predictor, images: Path) -> MetricValues:
    """Metrics on all images of a folder of shards, at the model's confidence threshold."""
    shards = ShardedDataset(images)
    return evaluate(*predict_shards(predictor, shards, shards.keys), predictor.confidence)


def table(metrics: MetricValues) -> str:
    """The errors, and the images and threshold of the measurement, as Markdown."""
    errors = pipe_table(headings(ACCURACY), [cells(metrics, ACCURACY)])
    images, shafts = (show(metrics[name], 0) for name in ("images", "instruments"))
    return (
        f"On {images} other renders, with {shafts} shafts. Errors are means over\n"
        "the shafts that were found, with a score of at least "
        f"{show(metrics['confidence'], 3)}.\n\n{errors}"
    )


if __name__ == "__main__":
    main()
