"""The numbers of Tables I and II of the paper, kept only here."""

from collections.abc import Mapping
from dataclasses import dataclass

TRAINING_IMAGES = 90_000
TEST_IMAGES = 10_000
REAL_TRAINING_IMAGES = 100
BATCH_SIZE = 32
SILHOUETTE_IMAGES = 20  # in each of Table II's sets


@dataclass(frozen=True)
class PaperRow:
    """A row of Table I: mean absolute errors on the paper's 10,000 artificial test images.

    `fps` is stated only for Architecture D, in the text (Quadro GV100).
    """

    title: str
    mAP: float
    detected_rate: float
    x_mm: float
    y_mm: float
    z_mm: float
    pitch_deg: float
    yaw_deg: float
    fps: float | None = None


@dataclass(frozen=True)
class PaperSilhouette:
    """A cell pair of Table II."""

    detected_rate: float
    iou: float


# By variant name, in the paper's order.
TABLE_I: Mapping[str, PaperRow] = {
    "c": PaperRow("C", 0.958, 0.937, 1.51, 1.41, 1.64, 3.97, 13.58),
    "d": PaperRow("D", 0.949, 0.956, 0.81, 0.76, 0.81, 1.57, 5.30, fps=30.4),
    "d_noise": PaperRow("D + noise", 0.965, 0.985, 0.65, 0.63, 0.75, 1.44, 4.26),
    "d_noise_real": PaperRow("D + noise + real", 0.965, 0.988, 0.66, 0.64, 0.77, 1.44, 4.33),
}

# By variant name, then by set of images: the paper's artificial images are "rendered" here.
TABLE_II: Mapping[str, Mapping[str, PaperSilhouette]] = {
    "d_noise": {
        "real/clear": PaperSilhouette(0.700, 0.197),
        "real/occluded": PaperSilhouette(0.700, 0.195),
    },
    "d_noise_real": {
        "rendered/clear": PaperSilhouette(0.950, 0.494),
        "rendered/occluded": PaperSilhouette(0.850, 0.369),
        "real/clear": PaperSilhouette(0.950, 0.471),
        "real/occluded": PaperSilhouette(0.825, 0.299),
    },
}
