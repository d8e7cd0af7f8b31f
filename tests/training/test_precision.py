"""The precision chosen on each device."""

from typing import Any

import pytest
import torch

from shaftpose.training.recipe import native_precision


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Pretends that the machine has a processor with these instructions, and a GPU or none."""

    def pretend(instructions: dict[str, bool], gpu: bool | None = None) -> None:
        monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: instructions)
        monkeypatch.setattr(torch.cuda, "is_available", lambda: gpu is not None)
        monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation: gpu)

    return pretend


@pytest.mark.parametrize(
    ("instructions", "precision"),
    [
        ({"avx512_bf16": True, "amx_bf16": True}, "bf16-mixed"),
        ({"avx512_bf16": True, "amx_bf16": False}, "32-true"),
        ({"avx2": True, "avx512_f": True}, "32-true"),
        ({"neon": True, "bf16": True}, "32-true"),
    ],
)
def test_a_processor_needs_instructions_for_bfloat16(
    device: Any, instructions: dict[str, bool], precision: str
) -> None:
    device(instructions)
    assert native_precision("auto") == native_precision("cpu") == precision


@pytest.mark.parametrize(("has_bfloat16", "precision"), [(True, "bf16-mixed"), (False, "32-true")])
def test_a_gpu_counts_where_it_trains(device: Any, has_bfloat16: bool, precision: str) -> None:
    device({"amx_bf16": not has_bfloat16}, gpu=has_bfloat16)
    assert native_precision("auto") == native_precision("gpu") == precision
    assert native_precision("cpu") != precision
