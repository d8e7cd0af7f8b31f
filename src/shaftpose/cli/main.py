"""The command line, `shaftpose`."""

import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module

from shaftpose.cli.options import parser
from shaftpose.core.errors import InputError, printable

_ENDINGS = (signal.SIGTERM, *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()))
_INTERRUPTED = 130  # the shells' status for Ctrl-C


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; an InputError ends it with one line and status 1."""
    options = parser().parse_args(arguments)
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115 closed by `2>&-`
    for name in _ENDINGS:
        if signal.getsignal(name) == signal.SIG_DFL:
            signal.signal(name, signal.default_int_handler)  # as Ctrl-C does
    try:
        # Only now: the command `check` has to run where a package is broken.
        import_module(f"shaftpose.cli.{options.command}").run(options)
        _flush_output()
    except InputError as error:
        with suppress(InputError):
            _flush_output()
        sys.exit(f"error: {printable(str(error))}")
    except BrokenPipeError:  # the reader of our output has enough, as in `| head`
        _forget_output()
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)


def _flush_output() -> None:
    """Raise InputError if what was printed cannot be written: the disk may be full."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        _forget_output()
        sys.exit(1)
    except OSError as error:
        _forget_output()
        raise InputError(f"standard output: cannot be written ({error.strerror})") from error


def _forget_output() -> None:
    """Keep Python from writing the rest as it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
