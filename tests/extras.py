"""Packages that the extra dev-all brings: their tests skip where they are absent, and fail where MASSPROP_TESTS=all asks for all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import pytest

PACKAGES = frozenset(
    {
        *("asammdf", "distributed", "fsspec", "h5py", "latex2mathml", "matio", "mcap", "mcap_ros2", "moto", "playwright", "pyulog"),
        *("rosbags", "s3fs", "zensical", "zstandard"),
    }
)
"""Names to import."""


def needed(module: str) -> Any:
    """A module of one of them; where it is absent all tests of the file that asks are skipped."""
    with optional(at_import=True):
        return import_module(module)


@contextmanager
def optional(at_import: bool = False) -> Iterator[None]:
    """Skips where one of the packages is absent."""
    try:
        yield
    except ModuleNotFoundError as error:
        absent = (error.name or "").partition(".")[0]
        if absent not in PACKAGES or os.environ.get("MASSPROP_TESTS") == "all":
            raise
        pytest.skip(f"{absent} is not installed: pip install -e '.[dev-all]'", allow_module_level=at_import)
