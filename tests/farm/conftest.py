"""Fixtures of the rendering tests, and an environment that is left as it was."""

import os
from collections.abc import Iterator

import pytest

from tests.rendering.conftest import backgrounds, settings, with_scene

__all__ = ["backgrounds", "settings", "with_scene"]


@pytest.fixture(autouse=True, scope="module")
def environment() -> Iterator[None]:
    """Dask sets OMP_NUM_THREADS where it starts workers: later tests would compute otherwise."""
    before = dict(os.environ)
    yield
    os.environ.clear()
    os.environ.update(before)
