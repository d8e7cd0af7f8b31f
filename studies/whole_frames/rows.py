"""The table of rows: which frames a model is measured on, and which figures have which aims."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.metrics.table import metrics_named
from studies.whole_frames.cost import cost_figures
from studies.whole_frames.figures import (
    called,
    errors_over_deviations,
    false_ones,
    found,
    mean,
    pose_errors,
    seen,
    share,
    tip_errors_px,
)
from studies.whole_frames.frames import (
    Reshape,
    inscribed_disc,
    inscribed_disc_and_panel,
    larger_disc,
    larger_disc_and_panel,
    wide,
)
from studies.whole_frames.measurement import Comparison, Frames, Measurement
from studies.whole_frames.record import Figure
from studies.whole_frames.rendering import VIEWS_DEG

FOUND = 0.97
SQUARES, CROSSED, OCCLUDED = Frames("squares"), Frames("crossed"), Frames("occluded")
WIDE, WIDE_UNKNOWN = Frames("wide", wide), Frames("wide", wide, camera_known=False)
VIEWS = {f"{deg} deg": Frames(f"view_{deg}") for deg in VIEWS_DEG}
# Round pictures, and whether their camera is stated: in a frame with a panel, the principal point
# is not in the middle.
ROUND: dict[str, tuple[Reshape, bool]] = {
    "inscribed": (inscribed_disc, True),
    "larger, off-centre": (larger_disc, True),
    "inscribed, with a panel": (inscribed_disc_and_panel, False),
    "larger, off-centre, with a panel": (larger_disc_and_panel, False),
}
MOST_MEANS = dict(zip(metrics_named(*POSE_DIMENSIONS), (0.06, 0.06, 0.13, 0.5, 0.2), strict=True))
LEAST_WITHIN = {1: 0.64, 2: 0.93, 3: 0.985}  # deviations


@dataclass(frozen=True)
class Row:
    """One kind of frames. squares: the rendered sets that they are cut from."""

    title: str
    squares: Sequence[str]
    measure: Callable[[Measurement], list[Figure]]


def wide_figures(comparison: Comparison) -> list[Figure]:
    """Shafts in 16:9 frames, by where the true tip lies."""
    tips = seen(comparison)
    outside = [shaft for shaft in comparison.shafts if shaft.tip == "outside"]
    return [
        found([t for t in tips if t.beside], "tips beside the central square, found", least=FOUND),
        found([t for t in tips if not t.beside], "tips inside it, found", least=FOUND),
        *false_ones(comparison),
        found(outside, "shafts with the tip outside, found"),
        *(called(outside, tip, f"of these, called {tip}") for tip in ("outside", "hidden", "seen")),
    ]


def unknown_camera_figures(measurement: Measurement) -> list[Figure]:
    """The same without a stated camera."""
    comparison = measurement.compared(WIDE_UNKNOWN)
    metric = [one.found.metric for one in comparison.detections]
    return [*wide_figures(comparison), share("detections called metric", metric, most=0)]


def view_figures(measurement: Measurement) -> list[Figure]:
    """Squares of other view angles than the model's."""
    tips = {name: seen(measurement.compared(frames)) for name, frames in VIEWS.items()}
    at_95 = _median(tip_errors_px(seen(measurement.compared(SQUARES))))
    errors = {name: _median(tip_errors_px(shafts)) for name, shafts in tips.items()}
    ratios = {
        name: None if error is None or not at_95 else error / at_95
        for name, error in errors.items()
    }
    rates = {name: found(shafts).value for name, shafts in tips.items()}
    every = found([shaft for shafts in tips.values() for shaft in shafts], least=FOUND)
    largest = max((ratio for ratio in ratios.values() if ratio is not None), default=None)
    return [
        Figure(every.name, every.value, every.on, least=FOUND, parts=rates),
        Figure(
            "largest of the angles' median tip errors, over that at 95 deg",
            largest, every.on, most=1.3, parts=ratios,
        ),
    ]  # fmt: skip


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def round_figures(measurement: Measurement) -> list[Figure]:
    """Round pictures, with and without a panel beside them."""
    figures = []
    for name, (reshape, known) in ROUND.items():
        comparison = measurement.compared(Frames("squares", reshape, known))
        figures.append(found(seen(comparison), f"{name}: tips found", least=FOUND))
        false = [one.is_false for one in comparison.detections]
        figures.append(share(f"{name}: detections without a true tip", false))
    return figures


def deviation_figures(measurement: Measurement) -> list[Figure]:
    """Shares of the errors within 1, 2 and 3 of the stated deviations."""
    tips = [t for frames in (SQUARES, CROSSED) for t in seen(measurement.compared(frames))]
    figures = []
    for name, crossed in (("open", False), ("crossed", True)):
        ratios = errors_over_deviations([tip for tip in tips if tip.crossed == crossed])
        for times, least in LEAST_WITHIN.items():
            within = (ratios <= times).mean(axis=0).tolist() if len(ratios) else [None] * 5
            figures.append(
                Figure(
                    f"{name} shafts, errors within {times} deviations, least of the dimensions",
                    min(within) if len(ratios) else None,
                    f"{len(ratios)} shafts", least=least,
                    parts=dict(zip(POSE_DIMENSIONS, within, strict=True)),
                )
            )  # fmt: skip
    return figures


def hidden_figures(measurement: Measurement) -> list[Figure]:
    """Tips behind tissue, and open ones."""
    hidden = [one for one in measurement.compared(OCCLUDED).shafts if one.tip == "hidden"]
    return [
        called(hidden, "seen", "hidden tips called seen", most=0.03),
        found(hidden, "shafts with a hidden tip, found"),
        called(seen(measurement.compared(SQUARES)), "seen", "open tips called seen"),
    ]


def square_figures(measurement: Measurement) -> list[Figure]:
    """Mean errors in squares of 1080 px."""
    tips = seen(measurement.compared(SQUARES))
    errors = pose_errors(tips).by_name
    means = [
        mean(f"mean error of {metric.heading}", errors[metric.name].tolist(), most)
        for metric, most in MOST_MEANS.items()
    ]
    return [found(tips), *means]


ROWS = {
    "wide": Row("16:9, 1911 x 1080 px", ["wide"], lambda taken: wide_figures(taken.compared(WIDE))),
    "no_camera": Row("the same, no camera stated", ["wide"], unknown_camera_figures),
    "views": Row(
        "squares of 40 to 100 deg, 1080 px",
        ["squares", *(frames.squares for frames in VIEWS.values())],
        view_figures,
    ),
    "round": Row("round pictures of 1080 px", ["squares"], round_figures),
    "deviations": Row("squares of 1080 px, tips seen", ["squares", "crossed"], deviation_figures),
    "hidden": Row("squares of 1080 px, occluded", ["squares", "occluded"], hidden_figures),
    "squares": Row("squares of 1080 px, errors", ["squares"], square_figures),
    "cost": Row(
        "1920 x 1080 px to fitted poses",
        ["wide"],
        lambda taken: cost_figures(
            taken.model, taken.rod.diameter_mm, taken.frames(WIDE), taken.count
        ),
    ),
}
