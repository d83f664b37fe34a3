"""What a reader of a log must know of it."""

from massprop_cli.base.dataclass import dataclass


@dataclass(frozen=True)
class Notice:
    """Something a reader must know; ``code`` is stable, ``message`` names numbers and a remedy."""

    code: str
    message: str
