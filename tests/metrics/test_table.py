"""The table of metrics against the names of results."""

import numpy as np

from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.frames.measures import frame_metrics
from shaftpose.metrics.image_metrics import SilhouetteScore
from shaftpose.metrics.metrics import evaluate
from shaftpose.metrics.symmetric_errors import SymmetricErrors
from shaftpose.metrics.table import METRICS, metrics_named, metrics_of
from shaftpose.report.paper_numbers import PaperRow, PaperSilhouette


def test_each_metric_is_in_the_results_of_its_kind() -> None:
    box, pose = np.array([[0.0, 0.0, 10.0, 10.0]]), np.array([[0.0, 0.0, 20.0, 70.0, 10.0]])
    measured = evaluate([Detections(box, np.ones(1), pose)], [Annotations(box, pose)])
    in_results = {
        *measured, "fps", *SymmetricErrors.__annotations__, *SilhouetteScore.__annotations__,
        *frame_metrics([], []).metrics,
    }  # fmt: skip
    assert {one.name for one in METRICS} <= in_results
    assert all(isinstance(measured[one.name], float) for one in METRICS if one.measure)


def test_names_are_unique_and_end_with_their_unit() -> None:
    assert len({one.name for one in METRICS}) == len(METRICS)
    assert all(one.name.endswith(f"_{one.unit}") for one in METRICS if one.unit)
    assert not any(one.higher_is_better for one in METRICS if one.unit)


def test_the_papers_metrics_are_those_of_its_tables() -> None:
    of_paper = {*PaperRow.__annotations__, *PaperSilhouette.__annotations__}
    assert {one.name for one in METRICS if one.in_paper} == of_paper - {"title", "fps"}


def test_rows_are_chosen_by_name_or_kind() -> None:
    tip, mAP = metrics_named("tip_mm", "mAP")
    assert (tip.heading, tip.label) == ("Tip [mm]", "Tip error [mm]")
    assert (mAP.heading, mAP.label) == ("mAP", "mAP")
    assert [one.name for one in metrics_of("image", "silhouette")][0] == "iou"
