"""The content of the report: a row for each variant, and the best of them."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from shaftpose.core.errors import InputError
from shaftpose.evaluation.results import Accuracy, Evaluation, Silhouettes
from shaftpose.figures.markdown import escape
from shaftpose.metrics.binned_errors import ErrorBin
from shaftpose.metrics.summary import Summary
from shaftpose.metrics.table import MetricValues
from shaftpose.origin import Origin
from shaftpose.report.champion import Champion
from shaftpose.report.paper_numbers import TABLE_I, PaperRow
from shaftpose.settings.parsing import flatten
from shaftpose.stage_files import REAL, STAND_IN, TrainingRecord

REFINEMENTS = {"mask": "fit", "edges": "fit", "views": "8 views"}  # `detection.refine` -> title


@dataclass(frozen=True)
class VariantRow:
    """One variant, trained once or several times with different seeds.

    metrics: means over `seeds`, see `metrics.metrics.measured`. spread: half the range of each,
    empty for one seed. width, depth: of the paper's backbone, None for other networks.
    detector_steps: of the profile's detector, 0 without a start checkpoint. parameters: number of
    weights. mixed_in_images: images without poses, besides `training_images`. title: shown if the
    paper has none. precision: of the training's numbers, as Lightning names it. settings: of the
    variant and its loss, by name. depths: errors by bins of the true depth. training_id: as in
    MLflow. data: digests of the rendered images with their split, and of mixed-in images. origin:
    of the evaluation. refinement: how poses are refined, as readers see it; empty for the network's
    own. silhouettes: fields of a `SilhouetteScore` by set of images, such as `rendered/clear`.

    summary, depths, training_id and origin are empty for several seeds. They, precision, settings
    and data may be empty in older results.
    """

    variant: str
    metrics: MetricValues
    training_images: int
    test_images: int
    steps: int
    batch_size: int
    width: float | None
    depth: float | None
    optimizer: str
    detector_steps: int
    seeds: tuple[int, ...]
    parameters: int
    mixed_in_images: int = 0
    title: str = ""
    precision: str = ""
    spread: MetricValues = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    summary: Summary | None = None
    depths: tuple[ErrorBin, ...] = ()
    training_id: str = ""
    data: tuple[str, ...] = ()
    origin: Origin | None = None
    refinement: str = ""
    silhouettes: Mapping[str, MetricValues] = field(default_factory=dict)

    @property
    def refined(self) -> bool:
        """Whether poses are refined."""
        return bool(self.refinement)

    @property
    def paper(self) -> PaperRow | None:
        """The paper's row, whose poses are the network's own."""
        return None if self.refined else TABLE_I.get(self.variant)

    def title_cell(self, domain: str, best: bool = False) -> str:
        """`shown_title` in Markdown; best: in bold."""
        title = escape(self.shown_title(domain))
        return f"**{title}**" if best else title

    def shown_title(self, domain: str) -> str:
        """The title by which readers know the row: the paper's, else its own, else its name.

        domain: what the images without poses are; if they are stand-ins, "D + real" becomes
        "D + stand-in".
        """
        title = TABLE_I[self.variant].title if self.variant in TABLE_I else self.title
        parts = [*(title or self.variant).split(" + "), *filter(None, [self.refinement])]
        return " + ".join(domain if part == REAL else part for part in parts)


@dataclass(frozen=True)
class AblationReport:
    """The content of the report.

    constant: metrics of the constant predictor; domain_label: what the images without poses are,
    `REAL` or `STAND_IN`; profile: the run's, of conf/profiles.yaml.
    """

    rows: list[VariantRow]
    constant: MetricValues
    domain_label: str
    champion: Champion
    profile: str

    def __post_init__(self) -> None:
        if self.domain_label not in (STAND_IN, REAL):
            raise InputError(
                f"domain_label is {self.domain_label!r}: use {STAND_IN!r} or {REAL!r}, so that "
                "readers know whether real images were measured"
            )

    @property
    def best(self) -> VariantRow | None:
        """The champion's row."""
        wanted = (self.champion.variant, self.champion.refined)
        return next((row for row in self.rows if (row.variant, row.refined) == wanted), None)


def variant_rows(
    name: str, evaluation: Evaluation, silhouettes: Silhouettes | None = None
) -> list[VariantRow]:
    """The table rows of one variant: its network's own poses and, if it has them, refined ones."""
    scores = silhouettes.by_kind if silhouettes else {}
    return [
        replace(
            _row(name, evaluation, accuracy),
            refinement=REFINEMENTS[evaluation.detection["refine"]] if kind == "refined" else "",
            silhouettes={images: asdict(one) for images, one in scores.get(kind, {}).items()},
        )
        for kind, accuracy in evaluation.by_kind.items()
    ]


def _row(name: str, evaluation: Evaluation, accuracy: Accuracy) -> VariantRow:
    training, metrics = evaluation.training, accuracy.metrics
    size, mixed_in = training.recipe["size"], training.data.mixed_in
    scaled = training.has_backbone
    return VariantRow(
        variant=name,
        title=evaluation.title,
        metrics=metrics,
        training_images=training.data.training_images,
        test_images=int(metrics["images"] or 0),
        steps=training.steps,
        batch_size=size["batch_size"],
        width=size["width"] if scaled else None,
        depth=size["depth"] if scaled else None,
        optimizer=size["optimizer"],
        precision=size["precision"],
        detector_steps=size["detector_steps"] if training.variant["start"] else 0,
        seeds=(training.seed,),
        parameters=training.parameters,
        mixed_in_images=mixed_in.images if mixed_in else 0,
        settings=_settings(training),
        summary=accuracy.summary,
        depths=tuple(accuracy.binned_errors["z_mm"]),
        training_id=training.training_id,
        data=(training.data.digest, *([mixed_in.digest] if mixed_in else [])),
        origin=evaluation.origin,
    )


def _settings(training: TrainingRecord) -> dict[str, Any]:
    """The settings of a training's variant, without its network."""
    flat = flatten({name: one for name, one in training.variant.items() if name != "network"})
    return {name: one for name, one in flat.items() if not name.endswith("_target_")}
