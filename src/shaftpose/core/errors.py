"""The exception for errors that the user can fix, and how it ends a command."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Warn = Callable[[str], None]  # tells the user of something that is no error


class InputError(ValueError):
    """A file, setting or value given by the user cannot be used.

    The message is one line that names the file or value and the remedy; the command line and the
    pipeline scripts print it without a traceback and exit with status 1.
    """


def printable(text: str) -> str:
    """Text for a terminal: names of files may hold codes that command it, and line feeds."""
    return "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in text)


@contextmanager
def exit_on_input_error() -> Iterator[None]:
    """End the command with one line and status 1 if an InputError is raised inside."""
    try:
        yield
    except InputError as error:
        sys.exit(f"error: {printable(str(error))}")
