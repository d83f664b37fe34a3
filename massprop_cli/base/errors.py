"""Errors that a user can act on; the command line turns them into one line and an exit code."""


class InputError(Exception):
    """Unusable input or configuration (exit 3). The message names file, place, value and remedy.

    ``option`` is that of the command line, or the keyword of the Python interface, by which it is corrected; empty where there is none.
    """

    def __init__(self, message: str, option: str = "") -> None:
        super().__init__(message)
        self.option = option


class MachineError(InputError):
    """Input that this machine doesn't take: a limit of its environment, a package that isn't there. Another run may."""


class UntoldError(InputError):
    """A log that cannot show its own delay or lag; ``settings``: likely values, each with a sigma, if any are likelier than others."""

    def __init__(self, message: str, settings: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.settings = settings


class AttitudeError(InputError):
    """A logged attitude that the gyro contradicts: the log may be estimated without it."""


class UsageError(Exception):
    """A command line that makes no sense (exit 2)."""
