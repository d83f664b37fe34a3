"""An assumption that an estimate takes for granted, and how it is varied."""

from __future__ import annotations

import numpy as np

from massprop_cli.base.dataclass import dataclass
from massprop_cli.model.sensitivity import Reading, Variant


@dataclass(frozen=True)
class AssumedValue:
    """An assumption, and how it is varied: ``size`` units make one step."""

    code: str
    message: str
    step: str
    stated: bool
    variant: Variant | Reading | None
    """None: of its parts, or of the columns that follow all variants."""
    size: float
    sigma: float = 0.0
    """One sigma, units, by which it is stated to be uncertain."""
    most: float = np.inf
    """Units by which it may be off at most: of a log that tells it no better than that, it is not tested."""
    part_of: str = ""
    """Code of that which it is a part of, whose effect is told: it is but tested by itself."""

    @property
    def whole(self) -> str:
        """Code of what is told."""
        return self.part_of or self.code
