"""Names of result folders from names of logs: one valid path component for any log name."""

import hashlib
import re
import unicodedata
from pathlib import PurePath

_UNSAFE = re.compile(r"[^\w.+=@ -]|^[. -]|[. ]$")
"""Characters not allowed in a folder's name, or at its ends."""
_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])(?=\.|$)", re.IGNORECASE)
"""Device names of Windows, with any suffix."""
_LONGEST = 120
"""Largest length of a name, bytes; longer names end with a digest."""


def safe(text: str) -> str:
    """The text as a folder's name: "_" replaces characters that a file system may refuse or interpret."""
    whole = _UNSAFE.sub("_", text) or "log"
    device = _DEVICE.match(whole)
    if device:
        whole = f"{whole[: device.end()]}_{whole[device.end() :]}"
    if len(whole.encode()) <= _LONGEST:
        return whole
    return f"{whole.encode()[:_LONGEST].decode(errors='ignore')}-{digest(whole)}"


def stem(file: str) -> str:
    """A file's name without suffix and .gz, from which the names of its vehicle file, map and result are derived."""
    plain = PurePath(file)
    return (plain.with_suffix("") if plain.suffix.lower() == ".gz" else plain).stem


def same(name: str) -> str:
    """Canonical form of a name, equal for names that some file system does not distinguish: case, composed accents."""
    return unicodedata.normalize("NFKC", name.casefold())


def digest(text: str, length: int = 8) -> str:
    """Hexadecimal digest of a text, for names that would otherwise be the same."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:length]
