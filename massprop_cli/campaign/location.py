"""Where logs and their companions are read from. Every byte that a job reads comes through here."""

from __future__ import annotations

from pathlib import Path

from massprop_cli.errors import InputError


def read(location: str, what: str) -> bytes:
    """The bytes of a file (``what`` it is, for messages); :class:`InputError` names it and a remedy."""
    path = Path(location)
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name the {what} itself")
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such {what}; check the path") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None


def text(content: bytes, location: str, what: str) -> str:
    """UTF-8 text; :class:`InputError` where it is none."""
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise InputError(f"{location}: not a text file ({error.reason} at byte {error.start}); a {what} is UTF-8 TOML") from None


def beside(location: str, name: str) -> str:
    """The location of another file in the same folder."""
    return str(Path(location).with_name(name))


def exists(location: str) -> bool:
    """Whether there is such a file."""
    return Path(location).exists()


def stem(location: str) -> str:
    """The file's name without its last suffix."""
    return Path(location).stem
