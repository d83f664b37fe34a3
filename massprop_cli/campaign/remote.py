"""Files at URLs, through fsspec. The store's package takes addresses and credentials from its configuration and the environment."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from massprop_cli.base import limits
from massprop_cli.base.errors import InputError, MachineError

EXTRA = "pip install 'massprop[remote]'"
_REFUSED = ("credential", "forbidden", "access denied", "accessdenied", "unauthorized", "invalidaccesskeyid", "signature")
"""Words in errors of stores that refuse access without a PermissionError."""


def store(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it; raise :class:`MachineError` if a package is missing."""
    try:
        import fsspec
    except ImportError:
        raise MachineError(f"{url}: reading and writing URLs needs the package fsspec; {EXTRA}") from None
    with store_errors(url, "URL"):
        system_and_path: tuple[Any, str] = fsspec.core.url_to_fs(url)
        return system_and_path


@contextmanager
def store_errors(url: str, what: str) -> Iterator[None]:
    """Raise :class:`InputError` with URL and remedy for any error of a store; each store has its own exceptions."""
    try:
        yield
    except InputError:
        raise
    except ImportError as error:
        raise MachineError(f"{url}: {_line(error)}; {EXTRA} has what s3:// needs, other stores the package named here") from None
    except FileNotFoundError as error:
        more = f" ({_line(error)})" if "bucket" in str(error).lower() and "/" not in str(error) else ""
        raise InputError(f"{url}: no such {what}{more}; check the URL") from None
    except IsADirectoryError:
        raise InputError(f"{url}: is a folder; name the {what} itself") from None
    except Exception as error:
        text = _line(error) or type(error).__name__
        refused = isinstance(error, PermissionError) or any(word in f"{type(error).__name__} {text}".lower() for word in _REFUSED)
        remedy = (
            "check the credentials in the environment, and what they may do"
            if refused
            else "check the URL's scheme"
            if isinstance(error, ValueError)
            else "check the network and the store's address, and run again"
        )
        raise InputError(f"{url}: {text}; {remedy}") from None


@contextmanager
def opened(url: str, what: str) -> Iterator[tuple[Any, str]]:
    """The file system of a URL and the path in it; errors of the store in the block become :class:`InputError`."""
    files, path = store(url)
    with store_errors(url, what):
        yield files, path


def read(url: str, what: str) -> bytes:
    """The bytes of a file; raise :class:`InputError` if they exceed the limit for its kind, before the download if possible."""
    limit = limits.of(what)
    with opened(url, what) as (files, path):
        limit.check(url, int(files.info(path).get("size") or 0))
        content = bytes(files.cat_file(path, start=0, end=limit.most + 1))
        limit.check(url, len(content))
        return content


def content_at(files: Any, path: str) -> bytes | None:
    """The present bytes of a file in a store, None if it does not exist."""
    files.invalidate_cache()  # another machine may have written it
    try:
        return bytes(files.cat_file(path))
    except FileNotFoundError:
        return None


def exists(url: str) -> bool:
    """Whether the file exists."""
    with opened(url, "file") as (files, path), suppress(FileNotFoundError):
        return bool(files.info(path)["type"] == "file")
    return False


def below(url: str) -> list[str]:
    """Relative paths of all files in a folder and below; empty if the folder does not exist."""
    paths: list[str] = []
    with opened(url, "folder") as (files, path), suppress(FileNotFoundError):
        files.invalidate_cache()  # another machine may have written files
        paths = [str(file) for file in files.find(path)]
        path = path.rstrip("/")
    return [file[len(path) :].lstrip("/") for file in paths if file.startswith(f"{path}/")]


def _line(error: BaseException) -> str:
    """The message of an error on one line."""
    return " ".join(str(error).split())
