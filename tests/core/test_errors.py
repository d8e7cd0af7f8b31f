"""The end of a command by an error that the user can fix."""

import pytest

from shaftpose.core.errors import InputError, exit_on_input_error


def test_an_input_error_ends_the_command_with_its_line() -> None:
    with pytest.raises(SystemExit, match="^error: it is missing$"), exit_on_input_error():
        raise InputError("it is missing")


def test_other_errors_keep_their_traceback() -> None:
    with pytest.raises(KeyError), exit_on_input_error():
        raise KeyError
