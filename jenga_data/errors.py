"""The one root of every error that a user can cause."""


class JengaError(Exception):
    """Bad input from a person or a file: the command line prints it as one line and exits with `exit_code`.

    A message says what was found, what is allowed, and what to run.
    """

    exit_code = 2


class CheckFailed(JengaError):
    """The input could be read, and what it says did not pass: damaged files, hashes that differ."""

    exit_code = 1


class UnreachableError(JengaError):
    """The arm cannot take the hand there, or not so fast."""
