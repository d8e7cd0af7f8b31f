from dataclasses import replace

import cv2
import numpy as np
import pytest

from shaftpose.backgrounds.tissue import MUCOSA, STAND_IN, TissueLook, render_tissue
from shaftpose.core.random_streams import streams

SIZE = 96


def pictures(look: TissueLook, count: int = 12) -> np.ndarray:
    return np.stack([render_tissue(streams(k), SIZE, look) for k in range(count)])


@pytest.fixture(scope="module")
def mucosa() -> np.ndarray:
    return pictures(MUCOSA)


@pytest.fixture(scope="module")
def stand_in() -> np.ndarray:
    return pictures(STAND_IN)


def test_same_streams_same_picture(mucosa: np.ndarray) -> None:
    again = render_tissue(streams(3), SIZE)
    assert again.dtype == np.uint8 and again.shape == (SIZE, SIZE, 3)
    assert np.array_equal(again, mucosa[3])


@pytest.mark.parametrize("size_px", [31, 160])
def test_any_size(size_px: int) -> None:
    assert render_tissue(streams(0), size_px).shape == (size_px, size_px, 3)


def test_pictures_differ_in_content_not_in_brightness_alone(mucosa: np.ndarray) -> None:
    grey = mucosa.mean(axis=-1).reshape(len(mucosa), -1)
    correlation = np.corrcoef(grey) - np.eye(len(grey))
    assert np.abs(correlation).max() < 0.85


def test_colours_vary_between_pictures(mucosa: np.ndarray) -> None:
    assert mucosa.mean(axis=(1, 2)).std(axis=0).min() > 5


def test_colours_vary_within_pictures(mucosa: np.ndarray) -> None:
    """Hue varies, not only brightness: the ratio of red to green is not constant."""
    ratio = (mucosa[..., 1] + 1.0) / (mucosa[..., 0] + 1.0)
    assert np.median(ratio.std(axis=(1, 2))) > 0.03


def test_red_dominates_in_every_picture(mucosa: np.ndarray, stand_in: np.ndarray) -> None:
    red, green, blue = np.moveaxis(np.concatenate([mucosa, stand_in]).mean(axis=(1, 2)), -1, 0)
    assert np.all(red > green) and np.all(red > blue)


def test_red_then_green_then_blue_in_the_mean(mucosa: np.ndarray, stand_in: np.ndarray) -> None:
    for images in (mucosa, stand_in):
        red, green, blue = images.mean(axis=(0, 1, 2))
        assert red > green + 20 and green > blue + 2


def test_exposure_is_neither_black_nor_burnt_out(mucosa: np.ndarray) -> None:
    means = mucosa.mean(axis=(1, 2, 3))
    assert means.min() > 50 and means.max() < 190


def test_near_is_bright_and_far_is_dark(mucosa: np.ndarray) -> None:
    """Light falls off with distance: most images span more than a third of the scale."""
    dark, bright = np.quantile(mucosa.mean(axis=-1).reshape(len(mucosa), -1), [0.02, 0.98], axis=1)
    assert np.median(bright - dark) > 85


def test_highlights_saturate_and_are_small(mucosa: np.ndarray) -> None:
    white = (mucosa.min(axis=-1) > 235).mean(axis=(1, 2))
    assert white.max() < 0.06
    assert np.count_nonzero(white) >= len(white) / 2
    assert mucosa.min(axis=-1).max() == 255


def test_neighbouring_pixels_are_alike(mucosa: np.ndarray) -> None:
    """Smooth folds, not noise: a slight blur removes little contrast."""
    for picture in mucosa.astype(np.float32):
        detail = picture - cv2.GaussianBlur(picture, (0, 0), 1.5)
        assert detail.std() < 0.5 * picture.std()


def test_the_stand_in_is_another_domain(mucosa: np.ndarray, stand_in: np.ndarray) -> None:
    """The stand-in is yellower: its green is closer to its red."""
    ratio_mucosa = mucosa[..., 1].mean() / mucosa[..., 0].mean()
    ratio_stand_in = stand_in[..., 1].mean() / stand_in[..., 0].mean()
    assert ratio_stand_in > ratio_mucosa + 0.08


def test_fluid_leaves_everything_else_of_a_picture() -> None:
    dry, wet = (replace(MUCOSA, fluid_chance=chance) for chance in (0.0, 1.0))
    for seed in range(3):
        one, other = (render_tissue(streams(seed), SIZE, look).astype(int) for look in (dry, wet))
        assert not np.array_equal(one, other)
        assert np.median(np.abs(one - other)) <= 2  # only the hollows differ
