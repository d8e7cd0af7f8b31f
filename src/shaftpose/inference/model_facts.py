"""What a model file states about itself in its metadata."""

import base64
from collections.abc import Mapping
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class ModelFacts:
    """Confidence thresholds, chosen on validation images, the camera and the shaft that the model
    was trained for, without which its millimetres are meaningless, and its edge reader.

    confidence: for the network's scores. fit_confidence: for those of fitted poses, which count the
    mask's support as well; None if poses cannot be fitted. The shaft's facts are None for an
    instrument from a CAD file. distorted: whether the camera had lens distortion. The default view
    angle is the paper's. edge_reader: a second ONNX model in bytes, see
    `inference.learned_edges`; None for a network without one.
    """

    confidence: float | None = None
    view_deg: float = 95.0
    shaft_diameter_mm: float | None = None
    shaft_length_mm: float | None = None
    shaft_tip: str | None = None
    distorted: bool = False
    fit_confidence: float | None = None
    edge_reader: bytes | None = None

    def as_text(self) -> dict[str, str]:
        """The facts that are known, by name; bytes in base 64."""
        return {
            name: base64.b64encode(value).decode() if isinstance(value, bytes) else str(value)
            for name, value in asdict(self).items()
            if value is not None
        }

    @classmethod
    def from_text(cls, stated: Mapping[str, str]) -> "ModelFacts":
        """The facts from metadata, which may hold other keys, too.

        Raises ValueError if a number is none, or bytes are not in base 64.
        """
        numbers = (
            "confidence", "fit_confidence", "view_deg", "shaft_diameter_mm", "shaft_length_mm"
        )  # fmt: skip
        known = {name: float(stated[name]) for name in numbers if name in stated}
        tip, distorted = stated.get("shaft_tip"), stated.get("distorted") == str(True)
        text = stated.get("edge_reader")
        reader = None if text is None else base64.b64decode(text, validate=True)
        return cls(**known, shaft_tip=tip, distorted=distorted, edge_reader=reader)
