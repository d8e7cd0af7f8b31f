"""The precision in which a device trains fastest."""

import torch

# The instructions by which a processor gains from bfloat16. Those of avx512_bf16 alone are no gain:
# a training step took 1.4 times as long as in single precision.
_CPU_BFLOAT16 = "amx_bf16"


def native_precision(accelerator: str) -> str:
    """Lightning's name of it: `bf16-mixed` if the device gains from bfloat16, else `32-true`.

    accelerator: `cpu`, `gpu` or `auto`, a GPU if there is one. Of processors only x86 is looked at:
    whether others gain was not tried.
    """
    if accelerator != "cpu" and torch.cuda.is_available():
        native = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        native = torch.cpu.get_capabilities().get(_CPU_BFLOAT16, False)
    return "bf16-mixed" if native else "32-true"
