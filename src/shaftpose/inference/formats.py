"""Formats of results: JSON lines, CSV, and the results table of BOP."""

import csv
import io
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import ShaftPose, unsigned_deg
from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.frame_sources.frames import FrameId
from shaftpose.inference.found_shafts import FoundShaft

CSV_COLUMNS = (
    "image", "frame", "time_s", "score", "x0", "y0", "x1", "y1", "tip_x_px", "tip_y_px",
    "axis_x_px", "axis_y_px", *POSE_DIMENSIONS, "metric", "tip", "track",
)  # fmt: skip
_FORMULAS = ("=", "+", "-", "@", "\t", "\r")  # that begin like these
BOP_COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
_SHAFT, _UNKNOWN_TIME = 1, -1  # our object's number, and BOP's value for an unknown time


@dataclass(frozen=True)
class Format:
    """A text format of results.

    suffix: of a results file. header: text at its beginning. lines: text for the shafts of a frame,
    each line with its line feed; raises InputError if the format cannot represent the frame.
    """

    suffix: str
    header: str
    lines: Callable[[FrameId, Sequence[FoundShaft]], str]


def json_line(frame: FrameId, shafts: Sequence[FoundShaft]) -> str:
    """One line for the frame, with all its shafts."""
    found = [as_row(shaft) for shaft in shafts]
    line = {"image": frame.source, "frame": frame.number, "time_s": _time_s(frame)}
    return json.dumps(line | {"instruments": found}) + "\n"


def _time_s(frame: FrameId) -> float | None:
    return None if frame.time_s is None else round(frame.time_s, 4)


def as_row(shaft: FoundShaft) -> dict[str, Any]:
    """A shaft as plain, rounded values."""
    return {
        "score": round(shaft.score, 4),
        "box": np.round(shaft.box, 1).tolist(),
        "tip_px": np.round(shaft.tip_px, 1).tolist(),
        "axis_px": np.round(shaft.axis_px, 1).tolist(),
        **_rounded(shaft.pose),
        "metric": shaft.metric,
        "tip": shaft.tip,
        "deviations": None if shaft.deviations is None else _named(shaft.deviations),
        "track": shaft.track,
    }


def _rounded(pose: ShaftPose) -> dict[str, float]:
    values = {name: round(getattr(pose, name), 2) for name in POSE_DIMENSIONS}
    return values | {"yaw_deg": unsigned_deg(values["yaw_deg"])}  # 359.996 is rounded to 360


def _named(values: np.ndarray) -> dict[str, float]:
    return {name: round(float(v), 3) for name, v in zip(POSE_DIMENSIONS, values, strict=True)}


def csv_lines(frame: FrameId, shafts: Sequence[FoundShaft]) -> str:
    """One line for each shaft."""
    return _table(
        [_no_formula(frame.source), frame.number, _time_s(frame), row["score"], *row["box"],
         *row["tip_px"], *row["axis_px"][1], *(row[name] for name in POSE_DIMENSIONS),
         "true" if row["metric"] else "false", row["tip"], row["track"]]
        for row in map(as_row, shafts)
    )  # fmt: skip


def _no_formula(name: str) -> str:
    """A file's name that no spreadsheet takes for a formula, and that still leads to the file."""
    return f"./{name}" if name.startswith(_FORMULAS) else name


class BopLines:
    """Lines of BOP's table for one run, in which each scene belongs to one folder or video."""

    def __init__(self) -> None:
        self._owners: dict[int, str] = {}  # scene -> its folder or video

    def __call__(self, frame: FrameId, shafts: Sequence[FoundShaft]) -> str:
        """One line for each shaft: scene number, image number, object 1, score, then rotation (row
        by row) and translation (mm) from the shaft's frame to the camera's.

        Raises InputError if the image file's name is not a number, or another folder or video of
        this run has the same scene number.
        """
        scene, image = _bop_numbers(frame)
        owner = (
            frame.source if frame.time_s is not None else str(Path(frame.source).absolute().parent)
        )
        first = self._owners.setdefault(scene, owner)
        if owner != first:
            raise InputError(
                f"--format bop: scene {scene} is that of {first}, whose image numbers could be the "
                "same; predict them one by one, or number folders as in 000003/rgb"
            )
        return _table(
            [scene, image, _SHAFT, f"{shaft.score:.4f}", _spaced(shaft.pose.rotation, 6),
             _spaced(shaft.pose.tip_mm, 3), _UNKNOWN_TIME]
            for shaft in shafts
        )  # fmt: skip


def _bop_numbers(frame: FrameId) -> tuple[int, int]:
    """Scene and image number, from paths like SCENE/rgb/IMAGE.png of BOP's datasets; of a video,
    scene 1."""
    if frame.time_s is not None:
        return 1, frame.number
    path = Path(frame.source)
    scene, image = path.absolute().parent.parent.name, path.stem
    if not image.isdecimal():
        raise InputError("--format bop needs a number as the file's name, as in 000012.png")
    return int(scene) if scene.isdecimal() else 1, int(image)


def _spaced(values: np.ndarray, digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values.flat)


def _table(rows: Iterable[Sequence[object]]) -> str:
    return "".join(map(_line, rows))


def _line(row: Sequence[object]) -> str:
    text = io.StringIO()
    # With the writer's own line ending, names that hold a part of it are quoted.
    csv.writer(text).writerow(row)
    return text.getvalue().removesuffix("\r\n") + "\n"


def format_of_run(name: str) -> Format:
    """The format of that name, for one run: `jsonl`, `csv` or `bop`."""
    return {
        "jsonl": Format("jsonl", "", json_line),
        "csv": Format("csv", ",".join(CSV_COLUMNS) + "\n", csv_lines),
        "bop": Format("csv", ",".join(BOP_COLUMNS) + "\n", BopLines()),
    }[name]
