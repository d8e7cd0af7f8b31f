"""Description of the machine of a benchmark."""

import os
import platform
from datetime import UTC, datetime

import psutil

from shaftpose.origin import processor


def machine() -> dict[str, str | int | float | None]:
    """Processor, cores, memory, Python and date, for a results file."""
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "memory_gib": round(psutil.virtual_memory().total / 2**30, 1),
        "python": platform.python_version(),
        "date": datetime.now(UTC).date().isoformat(),
    }
