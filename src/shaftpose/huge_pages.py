"""Memory in huge pages, in which networks on a CPU are faster.

Many systems, such as Ubuntu, give pages of 2 MB instead of 4 KB only to programs that ask for them.
Large arrays then fill the processor's table of pages, mostly in virtual machines. GNU's C library
asks if an environment variable says so when the program starts.
"""

import os
import platform
from pathlib import Path

TUNABLES, ASK = "GLIBC_TUNABLES", "glibc.malloc.hugetlb=1"
_MODE = Path("/sys/kernel/mm/transparent_hugepage/enabled")
_OLDEST = 2, 35  # GNU C library that knows the tunable


def advice() -> str:
    """What to type for huge pages; empty if they are given anyway, or cannot be had like this."""
    if not _MODE.is_file() or "[madvise]" not in _MODE.read_text():
        return ""
    library, version = platform.libc_ver()
    if library != "glibc" or tuple(map(int, version.split(".")[:2])) < _OLDEST:
        return ""
    others = os.environ.get(TUNABLES, "")
    if "glibc.malloc.hugetlb=" in others:
        return ""
    return f"export {TUNABLES}={others + ':' if others else ''}{ASK}"
