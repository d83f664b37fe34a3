"""Files at URLs, by fsspec. Addresses and credentials are what the store's own package finds in its configuration and environment."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from massprop_cli.base import limits
from massprop_cli.base.errors import InputError, MachineError

Answer = TypeVar("Answer")
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
    """What a store raises becomes an :class:`InputError` that names the URL and a remedy. Every store raises errors of its own."""
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


def asked(url: str, what: str, question: Callable[[Any, str], Answer]) -> Answer:
    """The answer of a store to ``question(file system, path)``; :class:`InputError` where it has none."""
    files, path = store(url)
    with told(url, what):
        return question(files, path)


def read(url: str, what: str) -> bytes:
    """The bytes of a file."""
    return bytes(asked(url, what, lambda files, path: _within(limits.of(what), url, files, path)))


def _within(limit: limits.Limit, url: str, files: Any, path: str) -> bytes:
    """The bytes of a file, once the store has said that they are not too many."""
    limit.check(url, int(files.info(path).get("size") or 0))
    found: bytes = files.cat_file(path, start=0, end=limit.most + 1)
    limit.check(url, len(found))
    return found


def content(url: str) -> bytes | None:
    """The same; None where there is no such file."""
    return asked(url, "file", content_at)


def content_at(files: Any, path: str) -> bytes | None:
    """The same in a store; what another machine wrote in the meantime counts too."""
    files.invalidate_cache()
    try:
        return bytes(files.cat_file(path))
    except FileNotFoundError:
        return None


def exists(url: str) -> bool:
    """Whether there is such a file."""
    return asked(url, "file", _is_file)


def _is_file(files: Any, path: str) -> bool:
    try:
        return bool(files.info(path)["type"] == "file")
    except FileNotFoundError:
        return False


def below(url: str) -> list[str]:
    """Paths, from a folder on, of all files in it and below; none where there is no such folder."""
    return asked(url, "folder", _below)


def _below(files: Any, path: str) -> list[str]:
    files.invalidate_cache()  # what another machine wrote in the meantime counts too
    try:
        found = files.find(path)
    except FileNotFoundError:
        return []
    root = path.rstrip("/")
    return [str(file)[len(root) :].lstrip("/") for file in found if str(file).startswith(f"{root}/")]


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())
