from pathlib import Path

import numpy as np
import pytest
import torch

from shaftpose.core.errors import InputError
from shaftpose.export.onnx_export import edge_reader_bytes
from shaftpose.export.parity import EDGE_TOLERANCE, edge_difference
from shaftpose.inference.learned_edges import LearnedEdges
from shaftpose.network.dense.edge_reader import EdgeReader
from shaftpose.refinement.contour import shaft_contour
from shaftpose.refinement.contour_sampling import scaled
from tests.conftest import constant_edge_reader
from tests.core.silhouettes import CAMERA, POSES, SHAFT


def test_columns_become_px_and_stated_errors_become_weights() -> None:
    edges = LearnedEdges(constant_edge_reader(offset=2.0, log_error=np.log(0.5)))
    contour = shaft_contour(POSES[0], SHAFT, CAMERA)
    grey = scaled(np.full((299, 299, 3), 90, np.uint8))
    offsets = edges(grey, contour, reach_px=6.0)  # 12 columns of 0.5 px
    np.testing.assert_allclose(offsets.px, 1.25, rtol=1e-6)  # 1 px is stated: it is cautious
    inside = offsets.weights > 0
    assert 0.8 < inside.mean() < 1  # rows at the border of the image do not count
    # The variance of a Laplace distribution is twice the square of its mean error.
    variance = 2 * 0.5**2 * (0.5**2 + 0.05**2)
    np.testing.assert_allclose(offsets.weights[inside], 1 / variance, rtol=1e-5)
    finer = edges(grey, contour, reach_px=3.0)
    np.testing.assert_allclose(finer.px, 0.625, rtol=1e-6)
    assert finer.weights.max() == pytest.approx(4 * offsets.weights.max())


def test_the_file_computes_what_the_network_does() -> None:
    torch.manual_seed(0)
    reader = EdgeReader()
    assert edge_difference(reader, LearnedEdges(edge_reader_bytes(reader))) < EDGE_TOLERANCE


@pytest.mark.parametrize("other", [(3.0, 0.0), (2.0, 0.1)])
def test_a_file_that_computes_something_else_is_noticed(other: tuple[float, float]) -> None:
    class Constant(torch.nn.Module):
        def forward(self, strips: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            rows = torch.ones(strips.shape[:1] + strips.shape[2:3])
            return 2.0 * rows, 0.0 * rows

    assert edge_difference(Constant(), LearnedEdges(constant_edge_reader(2.0, 0.0))) == 0
    assert edge_difference(Constant(), LearnedEdges(constant_edge_reader(*other))) > EDGE_TOLERANCE


def test_another_model_is_no_edge_reader(constant_model: Path) -> None:
    with pytest.raises(ValueError, match=r"an edge reader takes \{'image'"):
        LearnedEdges(constant_model.read_bytes())


def test_edges_that_are_not_finite_are_refused() -> None:
    with pytest.raises(InputError, match="the edge reader gives no finite offsets"):
        LearnedEdges(constant_edge_reader(offset=np.nan, log_error=0.0))
