"""An environment that is left as it was."""

from tests.farm.conftest import environment

__all__ = ["environment"]
