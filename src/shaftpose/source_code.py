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


def source_files(modules: Iterable[str], without: Iterable[str] = ()) -> list[Path]:
    """The modules' own files and those they import, directly or through others, sorted by name.

    Files outside of the package, and those of modules that compute no results, are left out. So are
    the modules `without`, and those imported through them alone.
    """
    found: set[str] = set()
    new = {name for name in modules if _counts(name)}
    while new := new - found - set(without):
        found |= new
        new = {other for name in new for other in _imported(name)}
    return [_file(name) for name in sorted(found)]


def _counts(name: str) -> bool:
    """Whether a name is that of a module of the package that computes results."""
    inside = name.startswith("shaftpose.") and _file(name).is_file()
    return inside and not any(f"{name}.".startswith(f"{other}.") for other in _PLUMBING)


@cache
def _imported(module: str) -> frozenset[str]:
    path = _file(module)
    folder = module if path.name == "__init__.py" else module.rpartition(".")[0]
    names = set(imported_names(ast.parse(path.read_text()), folder))
    return frozenset(name for name in names if _counts(name))


def imported_names(tree: ast.AST, folder: str = "") -> Iterator[str]:
    """Names imported anywhere in a file; `from a import b` yields a and a.b.

    folder: the package that the file's relative imports begin with.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = folder.split(".")[: 1 - node.level or None] if node.level else []
            source = ".".join([*above, node.module] if node.module else above)
            yield source
            yield from (f"{source}.{alias.name}" for alias in node.names)


def _file(module: str) -> Path:
    """A module's file; `__init__.py` if the name is a folder's or no module's."""
    path = Path(__file__).parent.joinpath(*module.split(".")[1:])
    return path.with_suffix(".py") if path.with_suffix(".py").is_file() else path / "__init__.py"
