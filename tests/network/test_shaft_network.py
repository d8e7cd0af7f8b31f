import torch

from shaftpose.network.shaft_network import ShaftNetwork, normalise_images


def test_outputs_have_one_row_per_default_box(tiny_network: ShaftNetwork) -> None:
    with torch.no_grad():
        outputs = tiny_network.eval()(torch.zeros(1, 3, 299, 299))
    assert [tuple(output.shape) for output in outputs] == [
        (1, len(tiny_network.defaults), values) for values in (2, 4, 5)
    ]


def test_normalised_images() -> None:
    images = torch.zeros(1, 2, 3, 3, dtype=torch.uint8)
    images[0, 1, 2] = torch.tensor([255, 0, 51])
    normalised = normalise_images(images)
    assert normalised.shape == (1, 3, 2, 3)
    torch.testing.assert_close(normalised[0, :, 1, 2], torch.tensor([1.0, -1.0, -0.6]))
    assert normalised.is_contiguous(memory_format=torch.channels_last)
