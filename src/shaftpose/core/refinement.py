"""What poses are fitted to: nothing; the mask; the mask, then the outline that the model's edge
reader finds in the image."""

from typing import Literal

Refinement = Literal["none", "mask", "edges"]
