"""Names of result folders, made from names of logs: one part of a path, whatever the log is called."""

import hashlib
import re
import unicodedata
from pathlib import PurePath

_UNSAFE = re.compile(r"[^\w.+=@ -]|^[. -]|[. ]$")
"""What a folder's name should not hold, or not begin or end with."""
_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])(?=\.|$)", re.IGNORECASE)
"""Names that Windows takes for a device, whatever comes after a dot."""
_LONGEST = 120
"""Bytes of a name; longer ones end with a digest."""


def safe(text: str) -> str:
    """The text as a folder's name: what a file system may refuse, or take for another folder, becomes "_"."""
    whole = _UNSAFE.sub("_", text) or "log"
    device = _DEVICE.match(whole)
    if device:
        whole = f"{whole[: device.end()]}_{whole[device.end() :]}"
    if len(whole.encode()) <= _LONGEST:
        return whole
    return f"{whole.encode()[:_LONGEST].decode(errors='ignore')}-{digest(whole)}"


def stem(file: str) -> str:
    """A file's name without its suffix, and without the .gz after that: what its vehicle file, its map and its result go by."""
    plain = PurePath(file)
    return (plain.with_suffix("") if plain.suffix.lower() == ".gz" else plain).stem


def same(name: str) -> str:
    """Equal for names that some file system takes for one: upper and lower case, accents spelt in two ways."""
    return unicodedata.normalize("NFKC", name.casefold())


def digest(text: str, length: int = 8) -> str:
    """Tells texts apart that make the same name."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:length]
