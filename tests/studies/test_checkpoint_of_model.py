"""Checkpoints of exported models, to train on from them."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera
from shaftpose.dataset.batches import Batch
from shaftpose.export.onnx_export import ShaftDetector, export_onnx
from shaftpose.export.parity import edge_difference, mask_difference
from shaftpose.inference.learned_edges import LearnedEdges
from shaftpose.inference.model_files import bundled_model
from shaftpose.inference.predictor import Predictor
from shaftpose.network.building import build_network, scale
from shaftpose.network.checkpoint import start_from_detector
from shaftpose.network.dense.network import DenseNetwork
from shaftpose.network.pose_network import normalise_images
from shaftpose.refinement.contour import Shaft
from shaftpose.settings.compose import composed_settings
from studies.checkpoint_of_model import load, take_statistics, write
from tests.network.dense.test_edge_reader import POSES, batch
from tests.network.tiny import E_LOSS, LIMITS


def network_of(channels: tuple[int, ...] | None) -> DenseNetwork:
    """Random weights; None: the network of the bundled model."""
    camera = Camera.from_field_of_view(299, 299, 95.0)
    return DenseNetwork(channels, camera, Shaft(3.0, 150.0, True), E_LOSS)


@pytest.fixture
def loaded() -> DenseNetwork:
    """The network of the bundled model, with its weights."""
    network = network_of(None)
    load(network, bundled_model())
    return network.eval()


def test_the_network_gives_what_the_file_gives(loaded: DenseNetwork) -> None:
    images = np.random.default_rng(1).integers(0, 256, (2, 299, 299, 3), np.uint8)
    model = Predictor(bundled_model(), "none")
    assert mask_difference(ShaftDetector(loaded, LIMITS), model, images) < 1e-4
    reader = loaded.edge_reader()
    assert reader is not None and model.metadata.edge_reader is not None
    assert edge_difference(reader, LearnedEdges(model.metadata.edge_reader)) < 1e-4


def test_the_network_of_an_export_made_here_gives_what_it_gives(tmp_path: Path) -> None:
    torch.manual_seed(0)
    camera = Camera.from_field_of_view(299, 299, 95.0)
    network, again = (DenseNetwork((8, 8, 8, 16), camera, None, E_LOSS) for _ in range(2))
    images = np.random.default_rng(1).integers(0, 256, (2, 299, 299, 3), np.uint8)
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = None  # statistics of images, instead of none
            nn.init.normal_(module.bias)
    network(normalise_images(torch.from_numpy(images)))
    export_onnx(ShaftDetector(network.eval(), LIMITS), tmp_path / "here.onnx", 299)
    load(again, tmp_path / "here.onnx")
    model = Predictor(tmp_path / "here.onnx", "none")
    assert mask_difference(ShaftDetector(again.eval(), LIMITS), model, images) < 1e-4


def test_a_training_begins_with_what_the_network_knew(loaded: DenseNetwork) -> None:
    inputs, targets = batch(list(POSES))
    images = (127.5 * (inputs + 1)).round().byte().permute(0, 2, 3, 1)
    inputs = normalise_images(images)
    with torch.no_grad():
        before = loaded(inputs)
        take_statistics(loaded, Batch(images, targets))
        for training in (False, True):
            after = loaded.train(training)(inputs)
            for was, now in zip(before[:2], after[:2], strict=True):
                torch.testing.assert_close(now, was, rtol=1e-3, atol=1e-3)


def test_a_training_may_start_from_the_checkpoint(loaded: DenseNetwork, tmp_path: Path) -> None:
    variant = composed_settings(Path(__file__).parents[2], "variant=e_real").variant
    write(loaded, variant, tmp_path / "former.ckpt")
    network = build_network(variant)
    start_from_detector(tmp_path / "former.ckpt", network, scale(variant))
    for name, weight in network.state_dict().items():
        torch.testing.assert_close(weight, loaded.state_dict()[name])


def test_a_file_of_another_network_is_refused() -> None:
    with pytest.raises(InputError, match=r"shaftpose\.onnx: lacks down\.\d"):
        load(network_of((8, 8, 8, 16)), bundled_model())
