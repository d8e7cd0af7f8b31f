"""How the variants were trained and evaluated, as Markdown."""

from shaftpose.figures.markdown import escape, pipe_table
from shaftpose.report.ablation import AblationReport
from shaftpose.report.cells import MISSING, show

SETUP = (
    "Variant", "Training images", "Test images", "Steps", "Batch", "Width", "Depth", "Optimiser",
    "Precision", "Detector steps", "Seeds", "Parameters", "Confidence",
)  # fmt: skip
ORIGIN = ("Variant", "Command", "Commit", "Machine", "Data", "Training")
ORIGINS = (
    "Evaluations with the profile {profile}. Commit: of the code; + marks changed files. Machine: "
    "of the evaluation. Data: digests of the rendered images with their split, and of real or "
    "stand-in images mixed in. Training: its id in MLflow, which has its settings. Table II comes "
    "from the stage evaluate_real, with the same models. Seeds and numbers of images are in the "
    "table above."
)


def setup_table(report: AblationReport) -> str:
    """Training settings of each row."""
    rows = [
        [
            row.title_cell(report.domain_label),
            *(show(n, 0) for n in (row.training_images, row.test_images, row.steps)),
            str(row.batch_size),
            *(MISSING if scale is None else f"{scale:g}" for scale in (row.width, row.depth)),
            row.optimizer.capitalize(),
            row.precision or MISSING,
            show(row.detector_steps or None, 0),
            ", ".join(str(seed) for seed in row.seeds),
            show(row.parameters, 0),
            show(row.metrics.get("confidence"), 2),
        ]
        for row in report.rows
    ]
    return pipe_table(SETUP, rows)


WEIGHTS = ("loss.alpha", "loss.gamma", "loss.beta")  # shown even if all rows agree
DIFFERENCES = (
    "The weights of the paper's loss (beta: of x, y, z, pitch, yaw), and the settings in which "
    "these rows differ."
)


def difference_table(report: AblationReport) -> str | None:
    """The weights of the loss and what else differs between rows; None if nothing is known."""
    rows = [row for row in report.rows if row.settings and not row.refined]
    names = dict.fromkeys([*WEIGHTS, *(name for row in rows for name in row.settings)])
    values = {name: [_value(row.settings.get(name)) for row in rows] for name in names}
    shown = [n for n in names if set(values[n]) - {MISSING}
             and (n in WEIGHTS or len(set(values[n])) > 1)]  # fmt: skip
    titles = [row.title_cell(report.domain_label) for row in rows]
    lines = zip(titles, *(values[name] for name in shown), strict=True)
    headings = [name.removeprefix("loss.") for name in shown]
    return pipe_table(["Variant", *headings], list(map(list, lines))) if shown else None


def _value(value: object) -> str:
    if value is None:
        return MISSING
    if isinstance(value, list | tuple):
        return ", ".join(map(_value, value))
    return f"{value:g}" if isinstance(value, float) else escape(str(value))


def origin_table(report: AblationReport) -> str | None:
    """How the numbers of each row were made, where that is known; None without any."""
    rows = [
        [
            row.title_cell(report.domain_label),
            escape(row.origin.command),
            escape(row.origin.commit or MISSING),
            escape(row.origin.machine),
            ", ".join(row.data),
            row.training_id,
        ]
        for row in report.rows
        if row.origin
    ]
    return pipe_table(ORIGIN, rows) if rows else None
