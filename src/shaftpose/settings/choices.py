"""Choices that the settings and the command line share. Imports nothing, so that both load fast."""

from typing import Literal

# The programs that can run an exported model.
Backend = Literal["onnxruntime", "openvino"]

# How poses are refined. none: not at all. mask, edges: if the model predicts a mask, poses are
# fitted to it, by edges then to the outline that the model's edge reader finds in the image. views:
# of every model, poses are means over the mirrored and turned image: `inference.symmetric_views`.
Refinement = Literal["none", "mask", "edges", "views"]
