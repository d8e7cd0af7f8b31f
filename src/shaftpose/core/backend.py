"""The programs that can run an exported model."""

from typing import Literal

Backend = Literal["onnxruntime", "openvino"]
