"""onnxruntime with bounds: a model file may come from anywhere."""

import re
from functools import cache

import onnxruntime

_MOST_BYTES = 4 * 2**30  # of all tensors in this process
_AS_REQUESTED = 1  # the arena grows by what is needed, not to the next power of two
_FATAL = 4  # what is less than that is an exception, too
# A node of this kind in ONNX's encoding, whose numbers may have needless bytes. It may run for
# ever; no export of this project has one.
_LOOP = re.compile(rb"(\x22|\xa2\x80*\x00)(\x04|\x84\x80*\x00)Loop")


def open_session(model: bytes, threads: int = 0) -> onnxruntime.InferenceSession:
    """Open an ONNX model. threads: 0: onnxruntime's own choice.

    Raises ValueError if the model has a loop, and onnxruntime's exceptions if it is none.
    """
    check_model(model)
    _bound_memory()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.log_severity_level = threads, _FATAL
    options.add_session_config_entry("session.use_env_allocators", "1")
    return onnxruntime.InferenceSession(
        model,
        options,
        providers=["CPUExecutionProvider"],
        enable_fallback=0,  # to other providers, which would print to standard output
    )


def check_model(model: bytes) -> None:
    """Raise ValueError if a model may run for ever."""
    if _LOOP.search(model):
        raise ValueError("it has a loop, which no export of this project has")


@cache
def _bound_memory() -> None:
    """Let all sessions share one arena of a bounded size."""
    arena = {
        "max_mem": _MOST_BYTES, "arena_extend_strategy": _AS_REQUESTED,
        "initial_chunk_size_bytes": -1,
        "max_dead_bytes_per_chunk": -1,
    }  # fmt: skip
    memory = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    onnxruntime.create_and_register_allocator(memory, onnxruntime.OrtArenaCfg(arena))
