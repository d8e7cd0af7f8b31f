"""Model files: the bundled ones, the one that `--model` names, and the metadata in them."""

import base64
import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import get_args

from shaftpose.core.errors import InputError
from shaftpose.settings.choices import Tip

FOLDER = Path(str(files("shaftpose"))) / "models"
DEFAULT = "shaftpose"  # the bundled model that is used if no model is named
CHECKSUM_SUFFIX, CARD_SUFFIX = ".onnx.sha256", ".md"

_REMEDY = "reinstall the package, or name another model"


def bundled_names() -> list[str]:
    """The names of the bundled models, the default one first."""
    names = {path.stem for path in FOLDER.glob("*.onnx")} - {DEFAULT}
    return [DEFAULT, *sorted(names)]


def bundled_model(name: str = DEFAULT) -> Path:
    """The file of a bundled model, whose SHA-256 has been checked.

    Raises InputError naming the file if it is missing or damaged.
    """
    model, recorded = FOLDER / f"{name}.onnx", FOLDER / f"{name}{CHECKSUM_SUFFIX}"
    for path in (model, recorded):
        if not path.is_file():
            raise InputError(f"{path}: missing; {_REMEDY}")
    if recorded.read_bytes() != checksum(model):
        raise InputError(f"{model}: damaged, its SHA-256 differs from {recorded.name}; {_REMEDY}")
    return model


def checksum(model: Path) -> bytes:
    """The line that `sha256sum` prints for a file when run in its folder."""
    return f"{hashlib.sha256(model.read_bytes()).hexdigest()}  {model.name}\n".encode()


DIAMETERS_MM = 1e-3, 1e3  # of shafts
# The lowest and highest values of numbers in a model's metadata.
_RANGES = {
    "confidence": (0.0, 1.0), "fit_confidence": (0.0, 1.0), "views_confidence": (0.0, 1.0),
    "view_deg": (0.1, 179.0),
    "shaft_diameter_mm": DIAMETERS_MM, "shaft_length_mm": (1e-3, 1e5),
    "low_pitch_deg": (0.0, 180.0), "high_pitch_deg": (0.0, 180.0),
}  # fmt: skip
SIDES_PX = 32, 4096  # of training images, and of what a network sees of frames
REGISTRY = "mlflow:/"  # prefix of names in a model registry


@contextmanager
def model_file(name: str | None) -> Iterator[Path]:
    """The ONNX file of a model, which exists until the block ends.

    name: a bundled model; a path, which is not checked; `mlflow:/NAME@ALIAS` or
    `mlflow:/NAME/VERSION` in a model registry; None for the default bundled model. Raises
    InputError if a bundled model is damaged or a registry's model cannot be downloaded.
    """
    if name is None or name in bundled_names():
        yield bundled_model(name or DEFAULT)
    elif name.startswith(REGISTRY):
        try:
            from shaftpose.tracking.models import registered_model
        except ImportError as error:
            raise InputError(
                f"{name}: needs MLflow: in a clone, pip install '.[pipeline]'"
            ) from error
        with registered_model(name.removeprefix(REGISTRY)) as path:
            yield path
    else:
        yield Path(name)


@dataclass(frozen=True)
class ModelMetadata:
    """The metadata of a model file: confidence thresholds, the camera and the shaft that the model
    was trained for, without which its millimetres are meaningless, and its edge reader.

    confidence: threshold for the network's scores. fit_confidence: threshold for the scores of
    fitted poses, which also depend on the mask; None if poses cannot be fitted. views_confidence:
    threshold for mean scores of eight views; None if the export did not choose one. All were chosen
    on validation images. view_deg: of the camera, side_px: of the training images; the defaults are
    the paper's. shaft_*: None for an instrument from a CAD file. distorted: whether the camera had
    lens distortion. edge_reader: a second ONNX model in bytes, see `inference.learned_edges`; None
    for a network without one. low_pitch_deg, high_pitch_deg: range of the training images' poses;
    None in files of older versions. frame_px: the shorter side of the image that a network of any
    size sees of a whole frame; None: side_px.
    """

    confidence: float | None = None
    view_deg: float = 95.0
    shaft_diameter_mm: float | None = None
    shaft_length_mm: float | None = None
    shaft_tip: str | None = None
    distorted: bool = False
    fit_confidence: float | None = None
    edge_reader: bytes | None = field(default=None, repr=False)
    side_px: int = 299
    low_pitch_deg: float | None = None
    high_pitch_deg: float | None = None
    frame_px: int | None = None
    views_confidence: float | None = None

    @property
    def pitches_deg(self) -> tuple[float, float] | None:
        """The range of pitches of the training images' poses, if it is known."""
        low, high = self.low_pitch_deg, self.high_pitch_deg
        return None if low is None or high is None else (low, high)

    def as_text(self) -> dict[str, str]:
        """Name -> value of all that is not None; bytes in base 64."""
        return {
            name: base64.b64encode(value).decode() if isinstance(value, bytes) else str(value)
            for name, value in asdict(self).items()
            if value is not None
        }

    @classmethod
    def from_text(cls, stated: Mapping[str, str]) -> "ModelMetadata":
        """Read the metadata of a file; other keys are ignored.

        Raises ValueError if a value is not a number, or not one that can be meant, or bytes are not
        in base 64.
        """
        known = {name: _number(name, stated[name]) for name in _RANGES if name in stated}
        side_px = _side("side_px", stated.get("side_px", str(cls.side_px)))
        frame_px = _side("frame_px", stated["frame_px"]) if "frame_px" in stated else None
        if known.get("low_pitch_deg", 0.0) > known.get("high_pitch_deg", 180.0):
            raise ValueError("low_pitch_deg: is above high_pitch_deg")
        tip, distorted = stated.get("shaft_tip"), stated.get("distorted", "False")
        if distorted not in ("True", "False"):
            raise ValueError(f"distorted: {distorted!r} is neither True nor False")
        if tip not in (None, *get_args(Tip)):
            raise ValueError(f"shaft_tip: {tip!r} is none of {', '.join(get_args(Tip))}")
        text = stated.get("edge_reader")
        reader = None if text is None else base64.b64decode(text, validate=True)
        return cls(
            **known, side_px=side_px, frame_px=frame_px, shaft_tip=tip,
            distorted=distorted == "True", edge_reader=reader,
        )  # fmt: skip


def _side(name: str, text: str) -> int:
    value, (low, high) = int(text), SIDES_PX
    if not low <= value <= high:
        raise ValueError(f"{name}: {value} is not from {low} to {high}")
    return value


def _number(name: str, text: str) -> float:
    value, (low, high) = float(text), _RANGES[name]
    if not low <= value <= high:  # NaN, too
        raise ValueError(f"{name}: {value:g} is not from {low:g} to {high:g}")
    return value
