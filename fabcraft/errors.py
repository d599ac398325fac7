"""What can go wrong for a user: every error says what was given, what was expected and what to do.

Each kind carries the exit code of the command line (0 printable, 1 made but the report has a failure,
2 usage or unreadable input, 3 something needed is absent, 4 no closed manifold could be made).
"""


class FabcraftError(Exception):
    """An error whose message is meant for the user; never shown with a traceback."""

    exit_code = 2

    def __init__(self, message: str, next_step: str = "") -> None:
        """`message`: what was given and what was expected.  `next_step`: what the user can do about it."""
        super().__init__(message)
        self.message = message
        self.next_step = next_step

    def __str__(self) -> str:
        return f"{self.message}\n  {self.next_step}" if self.next_step else self.message


class InputError(FabcraftError):
    """A file, flag, recipe or profile that cannot be used (exit 2)."""


class MissingError(FabcraftError):
    """Weights, a back end or an extra that is not there (exit 3); the next step carries the command."""

    exit_code = 3


class SolidError(FabcraftError):
    """No closed manifold could be made (exit 4)."""

    exit_code = 4
