"""Pictures of the documentation in few colours."""

import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from shaftpose.figures.style import save_figure
from studies.palette_pictures import main


def test_charts_take_less_room_and_look_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, figure = tmp_path / "chart.png", Figure()
    axes = figure.subplots()
    for slope in range(1, 8):
        axes.plot([0, 1], [0, slope])
    save_figure(figure, path)
    before, size = np.asarray(Image.open(path).convert("RGB"), dtype=float), path.stat().st_size
    monkeypatch.setattr(sys, "argv", ["palette_pictures", str(path)])
    main()
    after = np.asarray(Image.open(path).convert("RGB"), dtype=float)
    assert np.percentile(np.abs(after - before), 99.9) < 16  # of 255
    assert path.stat().st_size < 0.6 * size
    once = path.read_bytes()
    main()
    assert path.read_bytes() == once
