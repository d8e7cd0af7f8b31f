"""The end of a command by an error that the user can fix."""

import pytest

from shaftpose.core.errors import InputError, exit_on_input_error, printable


def test_an_input_error_ends_the_command_with_its_line() -> None:
    with pytest.raises(SystemExit, match="^error: it is missing$"), exit_on_input_error():
        raise InputError("it is missing")


def test_other_errors_keep_their_traceback() -> None:
    with pytest.raises(KeyError), exit_on_input_error():
        raise KeyError


def test_what_commands_a_terminal_is_spelt_out() -> None:
    assert printable("café a.png: 刀") == "café a.png: 刀"
    assert printable("\x1b[31m\n\u202e\udce9") == r"\x1b[31m\n\u202e\udce9"
