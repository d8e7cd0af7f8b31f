import io
import math
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from shaftpose.core.geometry import Camera
from shaftpose.core.instruments import Detections
from shaftpose.export.onnx_export import ShaftDetector, export_onnx, with_folded_norms
from shaftpose.export.parity import check_parity, mask_difference
from shaftpose.inference.predictor import Predictor
from shaftpose.network.dense.network import DenseNetwork
from shaftpose.network.pose_network import normalise_images
from shaftpose.network.ssd.heads import ArchitectureC, ArchitectureD
from shaftpose.network.ssd.inception_v4 import MAP_SIZES, InceptionV4Features
from shaftpose.network.ssd.pose_bins import BinCoder
from shaftpose.network.ssd.pose_coding import RegressionCoder
from shaftpose.network.ssd.single_shot import SingleShotNetwork
from tests.network.ssd.even_boxes import EVEN_CENTRES
from tests.network.tiny import E_LOSS, LIMITS, paper_loss


def random_images(count: int) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.randint(0, 256, (count, 299, 299, 3), generator=generator, dtype=torch.uint8)


RANGES = (-20, -20, 10, 50, 0), (20, 20, 40, 90, 358)


@pytest.fixture(scope="module")
def network() -> SingleShotNetwork:
    """Random weights, but with batch normalisation statistics of images, so that scores differ."""
    torch.manual_seed(0)
    network = SingleShotNetwork(
        InceptionV4Features(0.25, 0.25), ArchitectureD, RegressionCoder(*RANGES), paper_loss()
    )
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = None  # statistics are plain averages
    with torch.no_grad():
        network(normalise_images(random_images(4)))
    return network.eval()


@pytest.fixture(scope="module")
def session(
    network: SingleShotNetwork, tmp_path_factory: pytest.TempPathFactory
) -> onnxruntime.InferenceSession:
    path = tmp_path_factory.mktemp("export") / "network.onnx"
    noise = io.StringIO()
    with redirect_stdout(noise), redirect_stderr(noise):
        export_onnx(ShaftDetector(network, LIMITS), path, 299)
    assert noise.getvalue() == ""
    assert [file.name for file in path.parent.iterdir()] == ["network.onnx"]
    return onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])


def run(session: onnxruntime.InferenceSession, images: Tensor) -> list[NDArray[np.float32]]:
    return list(session.run(["boxes", "scores", "poses"], {"image": images.numpy()}))


def file_of(session: onnxruntime.InferenceSession) -> Any:
    """The session with the interface that the parity check calls."""

    def predict(images: NDArray[np.uint8]) -> list[Detections]:
        boxes, scores, poses = run(session, torch.from_numpy(images))
        return [
            Detections(b[s > 0], s[s > 0], p[s > 0])
            for b, s, p in zip(boxes, scores, poses, strict=True)
        ]

    return predict


@pytest.mark.parametrize("count", [1, 3])
def test_file_agrees_with_the_network(
    network: SingleShotNetwork, session: onnxruntime.InferenceSession, count: int
) -> None:
    images = random_images(count)
    detector = ShaftDetector(network, LIMITS)
    with torch.no_grad():
        expected = detector(images)
    _, scores, _ = run(session, images)
    assert expected.scores.std() > 0.01  # else the ranking would be random
    np.testing.assert_allclose(scores, expected.scores, atol=1e-3)
    # Rows whose scores differ by less than rounding may swap: match detections by their boxes.
    parity = check_parity(detector, file_of(session), images.numpy(), least_score=0.0)
    assert parity.holds
    assert parity.detections >= 15 * count
    assert parity.tied <= 2 * count


class ActiveNorm(nn.BatchNorm2d):
    """A normalisation that does more, as those of other libraries."""

    def forward(self, x: Tensor) -> Tensor:
        return super().forward(x).relu()


class Shortcut(nn.Module):
    """Children that do not run one after another."""

    def __init__(self) -> None:
        super().__init__()
        self.conv = nn.Conv2d(4, 4, 1)
        self.norm = nn.BatchNorm2d(4)

    def forward(self, x: Tensor) -> Tensor:
        return self.norm(self.conv(x) + x)


def test_only_plain_norms_after_their_convolution_are_folded() -> None:
    torch.manual_seed(0)
    plain = nn.Sequential(nn.Conv2d(3, 4, 3), nn.BatchNorm2d(4))
    active = nn.Sequential(nn.Conv2d(4, 4, 3), ActiveNorm(4))
    whole, x = nn.Sequential(plain, active, Shortcut()), torch.randn(2, 3, 9, 9)
    with torch.no_grad():
        for norm in (plain[1], active[1], whole[2].norm):
            norm.running_mean.uniform_(-1, 1)
            norm.running_var.uniform_(0.5, 2)
        whole.eval()
        folded = with_folded_norms(whole)
        torch.testing.assert_close(folded(x), whole(x))
    assert isinstance(folded[0][1], nn.Identity)


def test_names_and_types(session: onnxruntime.InferenceSession) -> None:
    (image,) = session.get_inputs()
    assert (image.name, image.type, image.shape[1:]) == ("image", "tensor(uint8)", [299, 299, 3])
    assert isinstance(image.shape[0], str)
    assert [output.name for output in session.get_outputs()] == ["boxes", "scores", "poses"]


class SampledColours(InceptionV4Features):
    """The image itself, resampled to the six sizes: a backbone that is quick to export."""

    def __init__(self) -> None:
        nn.Module.__init__(self)
        self.width, self.channels = 1.0, (3,) * len(MAP_SIZES)

    def forward(self, images: Tensor) -> list[Tensor]:
        """(B, 3, 299, 299) -> six maps (B, 3, size, size)."""
        return [functional.interpolate(images, (size, size)) for size in MAP_SIZES]

    def cell_centres(self) -> list[list[float]]:
        """Cell centres of each map, in units of the image's side."""
        return EVEN_CENTRES


def test_image_without_detection_is_all_zeros(tmp_path: Path) -> None:
    """Scores are exactly 0 on a black image and 1 on a white one in the same batch."""
    network = SingleShotNetwork(
        SampledColours(), ArchitectureC, RegressionCoder(*RANGES), paper_loss()
    )
    assert isinstance(network.head, ArchitectureC)
    for conv in network.head.class_convs:
        assert isinstance(conv, nn.Conv2d) and conv.bias is not None
        nn.init.zeros_(conv.weight)
        nn.init.zeros_(conv.bias)
        conv.weight.data[1::2, :, 1, 1] = 100.0  # the instrument's logit: 100 x the pixel's colours
    export_onnx(
        ShaftDetector(network, replace(LIMITS, max_detections=5)), tmp_path / "colours.onnx", 299
    )
    session = onnxruntime.InferenceSession(tmp_path / "colours.onnx")
    black_and_white = torch.zeros(2, 299, 299, 3, dtype=torch.uint8)
    black_and_white[1] = 255
    for values in run(session, black_and_white):
        assert not values[0].any()
        assert values[1].any()


def test_classes_are_decoded_inside_the_file(tmp_path: Path) -> None:
    """Architecture B: the file decodes its logits to the centres of the likeliest bins."""
    torch.manual_seed(0)
    coder = BinCoder(*RANGES, steps=(1, 1, 1, 5, 5))
    network = SingleShotNetwork(SampledColours(), ArchitectureC, coder, paper_loss())
    detector = ShaftDetector(network, LIMITS)
    export_onnx(detector, tmp_path / "classes.onnx", 299)
    session = onnxruntime.InferenceSession(tmp_path / "classes.onnx")
    images = random_images(4)
    file = file_of(session)
    parity = check_parity(detector, file, images.numpy(), least_score=0.0, continuous=False)
    assert parity.holds
    assert parity.detections == 4 * 20
    _, _, poses = run(session, images)
    bins = (poses - np.array(RANGES[0])) / coder.steps.numpy() - 0.5
    np.testing.assert_allclose(bins, bins.round(), atol=1e-4)
    assert all(len(np.unique(bins[..., dimension])) > 1 for dimension in range(5))


def test_a_dense_network_is_exported_with_its_decoding(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = DenseNetwork(
        (8, 8, 8, 16), Camera.from_field_of_view(299, 299, 95.0), None, E_LOSS
    ).eval()
    tips = network.maps[1]
    assert isinstance(tips, nn.Conv2d) and tips.bias is not None and network.mask.bias is not None
    nn.init.constant_(tips.bias[:1], 0.0)  # so that there are peaks,
    nn.init.constant_(network.mask.bias, 1.0)  # on shafts
    detector = ShaftDetector(network, LIMITS)
    export_onnx(detector, tmp_path / "dense.onnx", 299)
    file = file_of(onnxruntime.InferenceSession(tmp_path / "dense.onnx"))
    images = random_images(3).numpy()
    parity = check_parity(detector, file, images, least_score=0.0)
    assert parity.holds
    assert parity.detections > 3
    apart = mask_difference(detector, Predictor(tmp_path / "dense.onnx"), images)
    assert apart < 1e-5
    assert replace(parity, mask=apart).holds and not replace(parity, mask=0.01).holds
    assert not replace(parity, mask=math.nan).holds
