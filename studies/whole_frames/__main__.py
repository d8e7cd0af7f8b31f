"""Measure a model on whole frames of any shape and camera, against the project's aims.

`python -m studies.whole_frames --model shaftpose --frames 300` renders frames with the settings of
params.yaml on backgrounds of its own, without occluders and crossing shafts unless a row needs
them; finds their shafts; and writes the figures to reports/whole_frames/shaftpose.json, which
`make results` shows in docs/results.md. An interrupted run continues; another model is measured on
the same frames.
"""

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path

from benchmarks.machine import machine
from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.inference.model_files import DEFAULT, checksum, model_file
from shaftpose.refinement.contour import Shaft
from shaftpose.settings.compose import composed_settings
from studies.whole_frames.measurement import Measurement
from studies.whole_frames.record import COMMAND, RECORDS, Record, RecordedRow, add_rows, table
from studies.whole_frames.rendering import render
from studies.whole_frames.rows import ROWS

ROOT = Path(__file__).parents[2]
SEED = 43_100  # of images that no choice was made on


def main() -> None:
    """Measure the rows of the command line."""
    options = options_of()
    with exit_on_input_error(), model_file(options.model) as model:
        if options.frames < 1:
            raise InputError(f"--frames {options.frames}: give a number above 0")
        settings = composed_settings(ROOT, *options.settings)
        chosen = {name: ROWS[name] for name in options.rows}
        needed = dict.fromkeys(name for row in chosen.values() for name in row.squares)
        render(needed, settings, options.frames, options.seed)
        rod = Shaft(settings.shaft.diameter_mm, settings.shaft.length_mm)
        measurement = Measurement(model, rod, options.frames)
        command, out = repeating(options), options.out or RECORDS / f"{model.stem}.json"
        for name, row in chosen.items():
            figures = row.measure(measurement)
            verdicts = [f"{one.name}: {one.verdict}" for one in figures if one.verdict]
            recorded = RecordedRow(
                row.title, command, options.seed, options.frames, figures, verdicts
            )
            add_rows(out, Record(checksum(model).decode(), machine(), {name: recorded}))
            print(table({name: recorded}))
    print(f"written to {out}")


def repeating(options: argparse.Namespace) -> str:
    """The command that measures the same again, wherever this one writes its figures."""
    words = ["--model", options.model, "--frames", f"{options.frames}", "--seed", f"{options.seed}"]
    words += ["--rows", *options.rows]
    words += ["--settings", *options.settings] if options.settings else []
    return f"{COMMAND} {shlex.join(words)}"


def options_of(words: Sequence[str] | None = None) -> argparse.Namespace:
    """The options of these words, by default of the command line."""
    parser = argparse.ArgumentParser(COMMAND, description=__doc__.partition("\n")[0])
    parser.add_argument("--model", default=DEFAULT, help=f"as of `shaftpose predict` ({DEFAULT})")
    parser.add_argument("--frames", type=int, default=300, help="scales all counts (300)")
    parser.add_argument("--seed", type=int, default=SEED, help=f"of all images ({SEED})")
    parser.add_argument(
        "--rows", nargs="+", choices=ROWS, default=list(ROWS), metavar="ROW",
        help=f"what to measure, of {', '.join(ROWS)} (all)",
    )  # fmt: skip
    parser.add_argument(
        "--settings", nargs="+", default=[], metavar="KEY=VALUE",
        help="that override params.yaml, as in preset=laparoscopy cluster.workers=1",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, help=f"file ({RECORDS}/MODEL.json)")
    return parser.parse_args(words)


if __name__ == "__main__":
    main()
