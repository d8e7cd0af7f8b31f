"""Description of the machine of a benchmark."""

import os
import platform
from datetime import UTC, datetime
from pathlib import Path

import psutil

from shaftpose.huge_pages import TUNABLES
from shaftpose.origin import processor

# Of results. `make` and `BENCHMARKS=benchmarks/results` record them for the documentation.
RESULTS = Path(os.environ.get("BENCHMARKS", "reports/benchmarks"))
# Of x86 processors; what networks in 16 and 8 bits are fast with.
INSTRUCTIONS = ["avx2", "avx512f", "avx_vnni", "avx512_vnni", "avx512_bf16", "amx_bf16", "amx_int8"]


def machine() -> dict[str, str | int | float | None]:
    """Processor, cores, memory, Python and date, for a results file."""
    return {
        "processor": processor(),
        "instructions": instructions(),
        "cores": os.cpu_count(),
        "memory_gib": round(psutil.virtual_memory().total / 2**30, 1),
        "python": platform.python_version(),
        "tunables": os.environ.get(TUNABLES, ""),
        "date": datetime.now(UTC).date().isoformat(),
    }


def instructions() -> str:
    """Those of INSTRUCTIONS that the system says the processor has."""
    cpuinfo = Path("/proc/cpuinfo")
    stated = set(cpuinfo.read_text().split()) if cpuinfo.is_file() else set()
    return " ".join(name for name in INSTRUCTIONS if name in stated)
