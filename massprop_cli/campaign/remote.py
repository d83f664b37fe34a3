"""Files at URLs, by fsspec. Addresses and credentials are what the store's own package finds in its configuration and environment."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from massprop_cli.base import limits
from massprop_cli.base.errors import InputError, MachineError

EXTRA = "pip install 'massprop[remote]'"
_REFUSED = ("credential", "forbidden", "access denied", "accessdenied", "unauthorized", "invalidaccesskeyid", "signature")
"""What stores say that don't raise PermissionError."""


def store(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it; :class:`InputError` names the package that is missing."""
    try:
        import fsspec
    except ImportError:
        raise MachineError(f"{url}: reading and writing URLs needs the package fsspec; {EXTRA}") from None
    with told(url, "URL"):
        found: tuple[Any, str] = fsspec.core.url_to_fs(url)
        return found


@contextmanager
def told(url: str, what: str) -> Iterator[None]:
    """Turn a store's errors into :class:`InputError` with the URL and a remedy. Every store raises errors of its own."""
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
        said = _line(error) or type(error).__name__
        refused = isinstance(error, PermissionError) or any(word in f"{type(error).__name__} {said}".lower() for word in _REFUSED)
        remedy = (
            "check the credentials in the environment, and what they may do"
            if refused
            else "check the URL's scheme"
            if isinstance(error, ValueError)
            else "check the network and the store's address, and run again"
        )
        raise InputError(f"{url}: {said}; {remedy}") from None


@contextmanager
def opened(url: str, what: str) -> Iterator[tuple[Any, str]]:
    """The file system of a URL and the path in it; what the store raises while they are used becomes an :class:`InputError`."""
    files, path = store(url)
    with told(url, what):
        yield files, path


def read(url: str, what: str) -> bytes:
    """The bytes of a file, once the store has said that they are not too many."""
    limit = limits.of(what)
    with opened(url, what) as (files, path):
        limit.check(url, int(files.info(path).get("size") or 0))
        found = bytes(files.cat_file(path, start=0, end=limit.most + 1))
        limit.check(url, len(found))
        return found


def content_at(files: Any, path: str) -> bytes | None:
    """The bytes of a file in a store, None where there is none; what another machine wrote in the meantime counts too."""
    files.invalidate_cache()
    try:
        return bytes(files.cat_file(path))
    except FileNotFoundError:
        return None


def exists(url: str) -> bool:
    """Whether there is such a file."""
    with opened(url, "file") as (files, path), suppress(FileNotFoundError):
        return bool(files.info(path)["type"] == "file")
    return False


def below(url: str) -> list[str]:
    """Paths, from a folder on, of all files in it and below; none where there is no such folder."""
    found: list[str] = []
    with opened(url, "folder") as (files, path), suppress(FileNotFoundError):
        files.invalidate_cache()  # what another machine wrote in the meantime counts too
        found = [str(file) for file in files.find(path)]
        path = path.rstrip("/")
    return [file[len(path) :].lstrip("/") for file in found if file.startswith(f"{path}/")]


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())
