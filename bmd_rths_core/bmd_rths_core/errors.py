"""The one exception that means "what you gave me is wrong"."""

from __future__ import annotations


class InputError(ValueError):
    """Bad user input: a file, a parameter or an argument.

    The message is one line that names the file, line or parameter, the value found and what is allowed. Command
    lines print it as it is and leave with exit status 2; nothing has been written when it is raised.
    """
