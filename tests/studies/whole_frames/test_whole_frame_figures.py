"""Figures from shafts that are made by hand, their aims, and their record."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import ShaftPose
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.model_files import bundled_model, checksum
from shaftpose.refinement.contour import Shaft
from studies.whole_frames import rows
from studies.whole_frames.__main__ import options_of, repeating
from studies.whole_frames.figures import share
from studies.whole_frames.matching import Detection, TrueShaft
from studies.whole_frames.measurement import Comparison, Frames, Measurement
from studies.whole_frames.record import (
    RECORDS,
    Figure,
    Record,
    RecordedRow,
    add_rows,
    read_record,
    tables,
)

TRUE = np.array([1.0, 2, 20, 70, 359])
FOUND = FoundShaft(
    0.9, np.zeros(4), np.array([[10.0, 10], [20, 10]]), ShaftPose(1.1, 2, 20, 71, 1), True, "seen",
    np.array([0.06, 1, 1, 0.4, 2]),
)  # fmt: skip
SHAFT = TrueShaft(TRUE, np.array([13.0, 14]), "seen", False, True, False, FOUND)
MISSED = replace(SHAFT, found=None)


class Known(Measurement):
    """Shafts and detections that are the same on all frames, or on those of a name."""

    def __init__(self, *shafts: TrueShaft, **of_names: list[TrueShaft]) -> None:
        super().__init__(Path("model.onnx"), Shaft(3.0), 1)
        self._shafts, self._of_names = list(shafts), of_names

    def compared(self, chosen: Frames) -> Comparison:
        return Comparison(self._of_names.get(chosen.squares, self._shafts))


def values(figures: list[Figure]) -> list[float | None]:
    return [None if one.value is None else round(one.value, 3) for one in figures]


def test_wide_frames_by_where_the_tip_lies() -> None:
    beside = replace(MISSED, beside=True)
    outside = replace(SHAFT, tip="outside", found=replace(FOUND, tip="hidden"))
    detections = [
        Detection(FOUND, False, True),
        Detection(FOUND, True, True),
        Detection(replace(FOUND, tip="outside"), True, True),
        Detection(FOUND, True, False),
    ]
    figures = rows.wide_figures(Comparison([SHAFT, SHAFT, MISSED, beside, outside], detections))
    assert values(figures) == [0, 0.667, 0.75, 1, 1, 0, 1, 0]
    assert [one.on for one in figures[:4]] == ["0 of 1", "2 of 3", "3 of 4", "3"]
    assert [one.verdict for one in figures[:5]] == ["missed"] * 4 + [""]


def test_other_angles_are_compared_with_95_deg() -> None:
    # 5 px at all angles, 10 px at 40 deg.
    far = replace(SHAFT, tip_px=np.array([16.0, 18]))
    found, ratio = rows.view_figures(Known(SHAFT, view_40=[far, MISSED]))
    assert (found.on, found.parts["40 deg"]) == ("6 of 7", 0.5)
    assert ratio.value == 2
    assert ratio.parts["63 deg"] == 1
    assert ratio.verdict == "missed"


def test_shares_within_deviations_are_of_tips_called_seen() -> None:
    hidden = replace(SHAFT, found=replace(FOUND, tip="hidden"))
    alone = replace(SHAFT, found=replace(FOUND, deviations=None))
    crossed = replace(SHAFT, crossed=True)
    # Errors of 0.1 mm (1.7 deviations), 1 deg (2.5) and, across the seam, 2 deg (1).
    figures = rows.deviation_figures(
        Known(squares=[SHAFT, hidden, alone, MISSED], crossed=[crossed, crossed])
    )
    assert values(figures) == [0, 0, 1] * 2
    assert [one.on for one in figures] == ["1 shafts"] * 3 + ["2 shafts"] * 3
    assert list(figures[1].parts.values()) == [1, 1, 1, 0, 1]
    assert values(rows.deviation_figures(Known())) == [None] * 6


def test_hidden_tips_that_are_called_seen() -> None:
    hidden = replace(SHAFT, tip="hidden")
    known = replace(hidden, found=replace(FOUND, tip="hidden"))
    measured = Known(occluded=[hidden, known, known, replace(MISSED, tip="hidden"), SHAFT])
    called, found, _ = rows.hidden_figures(measured)
    assert (called.on, called.verdict, found.on) == ("1 of 3", "missed", "3 of 4")


def test_mean_errors_of_squares() -> None:
    exact = replace(SHAFT, found=replace(FOUND, pose=ShaftPose.from_array(TRUE)))
    figures = rows.square_figures(Known(SHAFT, exact, MISSED))
    assert values(figures) == [0.667, 0.05, 0, 0, 0.5, 1]
    assert [one.verdict for one in figures[1:]] == ["met", "met", "met", "met", "missed"]


def test_bars() -> None:
    assert share("", [True, False], least=0.5).verdict == "met"
    assert share("", [True, False], most=0.4).verdict == "missed"
    assert share("", [], most=0.4).verdict == "not measured"
    assert (share("", [True]).verdict, share("", [True]).aim) == ("", "")


def record(model: str, **figures: Figure) -> Record:
    recorded = {
        name: RecordedRow(name, "command", 3, 300, [one], [one.verdict])
        for name, one in figures.items()
    }
    return Record(model, {"cores": 2}, recorded)


def test_rows_of_the_same_model_are_kept(tmp_path: Path) -> None:
    path, one, other = tmp_path / "a.json", share("one", [True]), share("other", [False])
    add_rows(path, record("a", x=one, y=one))
    add_rows(path, record("a", y=other))
    assert {name: row.figures for name, row in read_record(path).rows.items()} == {
        "x": [one], "y": [other],
    }  # fmt: skip
    add_rows(path, record("b", y=other))
    assert read_record(path).rows.keys() == {"y"}


def test_the_recorded_command_says_what_was_measured_and_not_where_it_was_written() -> None:
    given = options_of(["--rows", "wide", "cost", "--frames", "40", "--out", "/elsewhere/a.json"])
    command = repeating(given)
    assert command == (
        "python -m studies.whole_frames --model shaftpose --frames 40 --seed 43100 --rows wide cost"
    )
    again = options_of(command.split()[3:])
    assert vars(again) == vars(given) | {"out": None}
    assert repeating(options_of(["--settings", "seed=1"])).endswith(" --settings seed=1")


def test_a_record_of_another_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / RECORDS / "shaftpose.json"
    own = checksum(bundled_model()).decode()
    add_rows(path, record(own, x=share("one", [True, False], least=0.97)))
    assert tables(tmp_path)["shaftpose"].splitlines()[-1] == (
        "| x | one | 0.5 | >= 0.97 | missed | 1 of 2 | 3 |"
    )
    add_rows(path, record("b", x=share("one", [True])))
    with pytest.raises(InputError, match=f"^{path}: measured of another model than the bundled"):
        tables(tmp_path)
