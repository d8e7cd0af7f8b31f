"""The exception type for all errors that the user can fix."""


class InputError(ValueError):
    """A file, setting or value given by the user cannot be used.

    The message is one line that names the file or value and the remedy; the command line and the
    pipeline scripts print it without a traceback and exit with status 1.
    """
