"""Memory in huge pages."""

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

from shaftpose import huge_pages

# 64 MB that Python asks for, and how much of the process lies in huge pages, in KB.
FILLED = """
from pathlib import Path
filled = b"1" * 64_000_000
print(Path("/proc/self/smaps_rollup").read_text().partition("AnonHugePages:")[2].split()[0])
"""


@pytest.mark.parametrize(
    ("mode", "library", "asked", "advised"),
    [
        ("always [madvise] never", ("glibc", "2.36"), "", True),
        ("always [madvise] never", ("glibc", "2.35"), "glibc.malloc.check=1", True),
        ("always [madvise] never", ("glibc", "2.36"), "glibc.malloc.hugetlb=1", False),
        ("always [madvise] never", ("glibc", "2.31"), "", False),
        ("always [madvise] never", ("", ""), "", False),
        ("[always] madvise never", ("glibc", "2.36"), "", False),
        ("always madvise [never]", ("glibc", "2.36"), "", False),
        (None, ("glibc", "2.36"), "", False),
    ],
)
def test_advice_is_given_where_it_helps(
    mode: str | None,
    library: tuple[str, str],
    asked: str,
    advised: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if mode is not None:
        (tmp_path / "enabled").write_text(f"{mode}\n")
    monkeypatch.setattr(huge_pages, "_MODE", tmp_path / "enabled")
    monkeypatch.setattr(platform, "libc_ver", lambda: library)
    monkeypatch.setenv("GLIBC_TUNABLES", asked)
    others = f"{asked}:" if asked else ""
    assert huge_pages.advice() == (
        f"export GLIBC_TUNABLES={others}glibc.malloc.hugetlb=1" if advised else ""
    )


def test_what_is_advised_gives_huge_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GLIBC_TUNABLES", raising=False)
    if not huge_pages.advice():
        pytest.skip("this system gives huge pages without being asked, or never")
    found = re.fullmatch(r"export (\w+)=(.+)", huge_pages.advice())
    assert found
    usual, huge = (
        int(subprocess.check_output([sys.executable, "-c", FILLED], env=os.environ | asked))
        for asked in ({}, {found[1]: found[2]})
    )
    assert huge - usual > 50_000
