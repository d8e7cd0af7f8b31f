"""The package files that a module's results depend on, found by following its imports."""

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

# These modules compute no results. The values they carry enter fingerprints directly.
_PLUMBING = tuple(
    f"shaftpose.{name}"
    for name in (
        "settings",
        "core.errors",
        "core.files",
        "stage_files",
        "origin",
        "source_code",
    )
)


def source_files(modules: Iterable[str]) -> list[Path]:
    """Package files that the modules reach, including their own, sorted by name."""
    found: set[str] = set()
    new = {name for name in modules if _counts(name)}
    while new:
        found |= new
        new = {other for name in new for other in _imported(name)} - found
    return [_file(name) for name in sorted(found)]


def _counts(module: str) -> bool:
    inside = module.startswith("shaftpose.") and _file(module).name != "__init__.py"
    return inside and not any(f"{module}.".startswith(f"{name}.") for name in _PLUMBING)


@cache
def _imported(module: str) -> frozenset[str]:
    names = set(imported_names(ast.parse(_file(module).read_text())))
    return frozenset(name for name in names if _is_module(name) and _counts(name))


def imported_names(tree: ast.AST) -> Iterator[str]:
    """Names imported anywhere in a file; `from a import b` yields both a and a.b."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield str(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _is_module(name: str) -> bool:
    if not name.startswith("shaftpose."):
        return False
    path = Path(__file__).parent.joinpath(*name.split(".")[1:])
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def _file(module: str) -> Path:
    path = Path(__file__).parent.joinpath(*module.split(".")[1:])
    return path.with_suffix(".py") if path.with_suffix(".py").is_file() else path / "__init__.py"
