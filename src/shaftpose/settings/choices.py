"""Choices that the settings and the command line share. Imports nothing, so that both load fast."""

from typing import Literal

# The programs that can run an exported model.
Backend = Literal["onnxruntime", "openvino"]

# The target of the fit of poses: none; the mask; the mask, then the outline that the model's edge
# reader finds in the image.
Refinement = Literal["none", "mask", "edges"]
