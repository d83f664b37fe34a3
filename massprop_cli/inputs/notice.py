"""Notices to the user about a log."""

from massprop_cli.base.dataclass import dataclass


@dataclass(frozen=True)
class Notice:
    """A notice to the user; ``code`` is stable, ``message`` states numbers and a remedy."""

    code: str
    message: str
