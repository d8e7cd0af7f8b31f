import torch

from shaftpose.network.pose_network import normalise_images


def test_normalised_images() -> None:
    images = torch.zeros(1, 2, 3, 3, dtype=torch.uint8)
    images[0, 1, 2] = torch.tensor([255, 0, 51])
    normalised = normalise_images(images)
    assert normalised.shape == (1, 3, 2, 3)
    torch.testing.assert_close(normalised[0, :, 1, 2], torch.tensor([1.0, -1.0, -0.6]))
    assert normalised.is_contiguous(memory_format=torch.channels_last)
