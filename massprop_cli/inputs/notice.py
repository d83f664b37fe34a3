"""Notices to the user about a log."""

from massprop_cli.base.dataclass import dataclass


@dataclass(frozen=True)
class Notice:
    """Notice to the user: a stable ``code``, and a ``message`` with numbers and a remedy."""

    code: str
    message: str
