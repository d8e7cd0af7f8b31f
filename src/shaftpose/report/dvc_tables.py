"""The report's numbers as the small tables that DVC shows: metrics, bars and learning curves."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from shaftpose.core.files import write_csv, write_json
from shaftpose.evaluation.results import HEADLINES, Evaluation
from shaftpose.figures.variant_figures import Curves
from shaftpose.metrics.table import MetricValues, metrics_named
from shaftpose.report.ablation import AblationReport, VariantRow

# Of the best variant: as many as fit the width of a terminal.
SUMMARY = metrics_named("mAP", "x_mm", "y_mm", "z_mm", "tip_mm", "axis_deg", "iou")
CURVES = metrics_named("mAP", "tip_mm", "axis_deg")


def write_dvc_tables(
    report: AblationReport, evaluations: Mapping[str, Evaluation], out: Path
) -> None:
    """Write `metrics.json` of the best variant and the tables of `plots/` to `out`."""
    write_json(out / "metrics.json", summary(report.best))
    rows = (
        [row.shown_title(report.domain_label), *(row.metrics.get(m.name) for m in HEADLINES)]
        for row in report.rows
    )
    names = [metric.name for metric in HEADLINES]
    write_csv(out / "plots/variants.csv", ["variant", *names], rows)
    curves = {name: one.curves for name, one in evaluations.items()}
    for metric in CURVES:
        table = wide(curves, f"validation/{metric.name}")
        write_csv(out / f"plots/{metric.name}.csv", ["step", *curves], table)


def summary(best: VariantRow | None) -> MetricValues:
    """The numbers of the best variant, rounded, since `dvc exp show` does not round."""
    if best is None:
        return {}
    known = {"iou": best.silhouettes.get("rendered/clear", {}).get("iou"), **best.metrics}
    values = {metric: known.get(metric.name) for metric in SUMMARY}
    return {one.name: None if v is None else round(v, one.digits) for one, v in values.items()}


def wide(curves: Mapping[str, Curves], name: str) -> Iterator[Sequence[object]]:
    """A row for each step: its number, and the value of each variant, empty where it has none."""
    values = {
        (step, variant): value
        for variant, rows in curves.items()
        for step, logged, value in rows
        if logged == name
    }
    for step in sorted({step for step, _ in values}):
        yield [step, *(values.get((step, variant), "") for variant in curves)]
