"""The precision in which a device trains fastest."""

import torch

# Instructions by which a processor computes in bfloat16. One without them converts every number to
# single precision and back, which makes it many times slower than single precision alone.
_CPU_BFLOAT16 = ("avx512_bf16", "amx_bf16")


def native_precision(accelerator: str) -> str:
    """Lightning's name of it: `bf16-mixed` if the device computes in bfloat16, else `32-true`.

    accelerator: `cpu`, `gpu` or `auto`, a GPU if there is one. Of processors only x86 is looked at:
    whether others gain was not tried.
    """
    if accelerator != "cpu" and torch.cuda.is_available():
        native = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        capabilities = torch.cpu.get_capabilities()
        native = any(capabilities.get(name, False) for name in _CPU_BFLOAT16)
    return "bf16-mixed" if native else "32-true"
