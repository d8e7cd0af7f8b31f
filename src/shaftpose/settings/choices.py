"""Choices that the settings and the command line share. Imports nothing, so that both load fast."""

from typing import Literal

# The programs that can run an exported model.
Backend = Literal["onnxruntime", "openvino"]

# How poses are refined. none: not at all. mask: fitted to the model's mask. edges: fitted to the
# mask, then to the outline that the model's edge reader finds in the image. Models without a mask
# ignore both. views: means over the image and its mirrored and turned copies.
Refinement = Literal["none", "mask", "edges", "views"]

# The end of a rod.
Tip = Literal["flat", "chamfered", "rounded", "forceps"]
