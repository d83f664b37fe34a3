"""Errors that a user can act on; the command line turns them into one line and an exit code."""


class InputError(Exception):
    """Unusable input or configuration (exit 3); the message names file, place, value and remedy.

    ``option`` is the command-line option, or the keyword of the Python interface, that corrects it; empty without one.
    """

    def __init__(self, message: str, option: str = "") -> None:
        super().__init__(message)
        self.option = option


class MachineError(InputError):
    """Input that exceeds a limit of this machine or needs a missing package; it may be usable elsewhere."""


class UntoldError(InputError):
    """Log that does not inform its delay or lag; ``settings`` are the most likely values with sigmas, if there are any."""

    def __init__(self, message: str, settings: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.settings = settings


class AttitudeError(InputError):
    """Logged attitude that the gyro contradicts; the log may be usable without it."""


class UsageError(Exception):
    """Invalid command line (exit 2)."""
