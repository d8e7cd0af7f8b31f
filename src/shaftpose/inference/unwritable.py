"""Results that cannot be kept, which ends a prediction."""

from collections.abc import Iterator
from contextlib import contextmanager

from shaftpose.core.errors import InputError


class UnwritableError(InputError):
    """Results cannot be written: unlike an unreadable image, this would befall all that follow."""


def incomplete(path: object) -> UnwritableError:
    """The error of a file whose writer does not say what it could not write."""
    return UnwritableError(
        f"{path}: not complete; name another folder by --out, on a disk with room; the other "
        "results are kept"
    )


@contextmanager
def naming_unwritable(path: object) -> Iterator[None]:
    """Turn the system's refusal to write a file into an UnwritableError naming it. A closed pipe
    stays a BrokenPipeError: whoever read it has enough."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise UnwritableError(
            f"{path}: cannot be written ({error.strerror}); name another folder by --out, on a "
            "disk with room; earlier results are kept"
        ) from error
