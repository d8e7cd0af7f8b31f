"""What poses are fitted to: nothing; the mask; the mask, then the edges of the image."""

from typing import Literal

Refinement = Literal["none", "mask", "edges"]
