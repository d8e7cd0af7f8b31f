"""The precision in which a device trains fastest."""

from typing import Literal

import torch

# The CPU instructions that make bfloat16 faster. avx512_bf16 alone does not: a training step took
# 1.4 times as long as in single precision.
_CPU_BFLOAT16 = "amx_bf16"


def native_precision(accelerator: str) -> Literal["32-true", "bf16-mixed"]:
    """Lightning's precision name: `bf16-mixed` if bfloat16 is faster, else `32-true`.

    accelerator: `cpu`, `gpu` or `auto`, a GPU if there is one. Only x86 CPUs can get `bf16-mixed`;
    others were not tested.
    """
    if accelerator != "cpu" and torch.cuda.is_available():
        native = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        native = torch.cpu.get_capabilities().get(_CPU_BFLOAT16, False)
    return "bf16-mixed" if native else "32-true"
