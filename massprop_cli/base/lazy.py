"""Libraries imported on first use: importing Arrow alone takes as long as one estimate, and few runs draw figures."""

from importlib import import_module
from typing import Any


class _Lazy:
    """Module that is imported when an attribute is read."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        return getattr(import_module(self._name), attribute)


pa: Any = _Lazy("pyarrow")
pc: Any = _Lazy("pyarrow.compute")
pq: Any = _Lazy("pyarrow.parquet")
pacsv: Any = _Lazy("pyarrow.csv")
mpl: Any = _Lazy("matplotlib")
mplfigure: Any = _Lazy("matplotlib.figure")
ticker: Any = _Lazy("matplotlib.ticker")
jinja2: Any = _Lazy("jinja2")
markupsafe: Any = _Lazy("markupsafe")
