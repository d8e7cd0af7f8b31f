"""The command line, `shaftpose`."""

import os
import sys
from collections.abc import Sequence
from importlib import import_module

from shaftpose.cli.options import parser
from shaftpose.core.errors import InputError

_INTERRUPTED = 130  # the shells' status for Ctrl-C


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; an InputError ends it with one line and status 1."""
    options = parser().parse_args(arguments)
    try:
        # Only now: the command `check` has to run where a package is broken.
        import_module(f"shaftpose.cli.{options.command}").run(options)
    except InputError as error:
        sys.exit(f"error: {error}")
    except BrokenPipeError:  # the reader of our output has enough, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
