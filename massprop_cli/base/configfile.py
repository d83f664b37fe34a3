"""TOML files checked against a pydantic model, with errors that name file, line, key and remedy."""

import difflib
import json
import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from massprop_cli.base import limits
from massprop_cli.base.errors import InputError

Model = TypeVar("Model", bound=BaseModel)
_HEADER = re.compile(r"^\s*\[(\[?)\s*([^\]]+?)\s*\]")
_INTERNAL = ("function-", "literal[", "constrained-", "[key]")
"""Prefixes of path components that pydantic adds to the keys of the file."""
KEY = "key"
"""Entry of an error's context with the invalid key."""
_SHOWN = 40
"""Characters shown of a text that is too long."""
_QUOTED = re.compile(r"""\"{3}[\s\S]*?(?:\"{3}|\Z)|'{3}[\s\S]*?(?:'{3}|\Z)|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|#[^\n]*""")
"""Quoted keys, texts and comments of TOML."""
_DOTTED = re.compile(r"(?<![\w-])[\w-]+(?:[ \t]*\.[ \t]*[\w-]+)+")
_LIST = re.compile(r"\[\n((?:\s+[-+.\w]+,\n)+)\s*\]")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
"""TOML keys that need no quotes."""
_KEY = re.compile(r"""^\s*["']?([\w.\-]+)["']?\s*=""")


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Parse TOML; :class:`InputError` names the file and the line of a syntax error."""
    limits.CONFIG.check(source, len(text))
    # tomllib stores every prefix of a dotted key, which needs gigabytes for 100,000 parts
    parts = max((key.count(".") + 1 for key in _DOTTED.findall(_QUOTED.sub(_unquoted, text))), default=0)
    limits.DEPTH.check(source, parts)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: not valid TOML: {error}") from None


def _unquoted(found: re.Match[str]) -> str:
    """Replacement of a quoted key or text by one word, and of comments and multi-line texts by nothing."""
    return "" if found[0].startswith(("#", '"""', "'''")) else "q"


def bounded(data: object, source: str) -> None:
    """Raise :class:`InputError` if keys or texts are too long, or tables nested too deeply."""
    level: list[object] = [data]
    depth = 0
    while level:
        limits.DEPTH.check(source, depth)
        depth += 1
        for text in (item for item in level if isinstance(item, str)):
            limits.TEXT.check(f"{source}: {text[:_SHOWN]!r}", len(text))
        for key in (key for item in level if isinstance(item, dict) for key in item):
            limits.NAME.check(f"{source}: key {key[:_SHOWN]!r}", len(key))
        within = (item.values() if isinstance(item, dict) else item if isinstance(item, list) else () for item in level)
        level = [child for children in within for child in children]


def read_text(path: Path, what: str) -> str:
    """Text of a file; :class:`InputError` if it is missing, not a regular file, too large, or not UTF-8."""
    try:
        return decoded(limits.content(path, what), str(path), what)
    except FileNotFoundError:
        raise InputError(f"{path}: no such {what}; check the path") from None


def decoded(content: bytes, place: str, what: str) -> str:
    """Decoded UTF-8 text with Unix line ends; :class:`InputError` if it is not UTF-8."""
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        kind = "JSON" if what.endswith(".json") else "TOML"
        raise InputError(f"{place}: not a text file ({error.reason} at byte {error.start}); a {what} is UTF-8 {kind}") from None


def override(data: dict[str, Any], assignments: Iterable[str]) -> dict[str, Any]:
    """Apply ``dotted.key=value`` (TOML literal or plain string) to parsed TOML; numbers pick list items (``jets.0.rise_s=0.003``)."""
    for assignment in assignments:
        key, equals, text = assignment.partition("=")
        if not equals or not key.strip():
            raise InputError(f"setting {assignment}: not KEY=VALUE; write for instance convergence.count=50")
        _assign(data, key.strip().split("."), literal(text.strip()), f"setting {assignment}")
    return data


def literal(text: str) -> object:
    """Value of a TOML literal, or the text itself if it is not one."""
    try:
        found = parse_toml(f"value = {text}", "value")
    except InputError:
        return text
    # a multi-line value may define further keys
    return found["value"] if len(found) == 1 else text


def toml(data: Mapping[str, Any]) -> str:
    """TOML text with each list of numbers on one line."""
    import tomli_w

    return _LIST.sub(lambda found: "[" + ", ".join(found[1].replace(",", " ").split()) + "]", tomli_w.dumps(data))


def written(value: object) -> str:
    """A value as a one-line TOML literal; :class:`InputError` if TOML has no such type."""
    value = value.tolist() if hasattr(value, "tolist") else value  # NumPy's
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (str, Path)):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        names = (key if _BARE.fullmatch(key) else written(key) for key in map(str, value))
        return "{" + ", ".join(f"{name} = {written(child)}" for name, child in zip(names, value.values(), strict=True)) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(written, value)) + "]"
    raise InputError(f"{value!r}: expected a number, text, list or mapping; give one, or leave the key out")


def _assign(data: dict[str, Any], path: list[str], value: object, source: str) -> None:
    node: Any = data
    for part in path[:-1]:
        if isinstance(node, list):
            if not part.isdecimal() or int(part) >= len(node):
                raise InputError(f"{source}: {part!r} is not an item of a list of {len(node)}; count from 0")
            node = node[int(part)]
        else:
            node = node.setdefault(part, {})
        if not isinstance(node, (dict, list)):
            raise InputError(f"{source}: {part!r} is a value, not a table")
    if isinstance(node, list):
        raise InputError(f"{source}: name the key to set inside the list item")
    if isinstance(node.get(path[-1]), dict) and not isinstance(value, dict):
        raise InputError(f"{source}: {path[-1]!r} is a table; name the key in it to set")
    node[path[-1]] = value


_BEYOND = {"greater_than": ("gt", "greater than"), "less_than": ("lt", "less than")}
"""Context entry and words of pydantic's limit errors."""


def validate(model: type[Model], data: Mapping[str, Any], source: str, text: str = "", assignments: Sequence[str] = ()) -> Model:
    """Check ``data``; :class:`InputError` names line or assignment, dotted key and value, and the known key nearest to an unknown one."""
    bounded(data, source)
    try:
        # strict JSON mode accepts lists for tuples, and refuses true or "10" for numbers
        return model.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        # a misspelt key gives an unknown and a missing key: report the unknown one
        first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
        path = [str(part) for part in first["loc"] if not str(part).startswith(_INTERNAL)]
        path += [str(first["ctx"][KEY])] if KEY in first.get("ctx", {}) else []
        blamed = [a for a in assignments if path[: len(_path(a))] == _path(a) or _path(a)[: len(path)] == path]
        line = line_of(text, path)
        where = f"setting {blamed[-1]}" if blamed else f"{source}, line {line}" if line else source
        raise InputError(f"{where}: {_explain(model, first, path)}") from None


def _path(assignment: str) -> list[str]:
    return assignment.partition("=")[0].strip().split(".")


def _explain(model: type[BaseModel], error: Any, path: list[str]) -> str:
    key = ".".join(path)
    if error["type"] == "extra_forbidden":
        known = sorted({name for node in _nodes(model, path[:-1]) for name in node.get("properties", {})})
        return f"unknown key {key!r}{nearest(path[-1], known, 'the nearest known key is')}"
    if error["type"] == "missing":
        return f"key {key!r} is missing; add it{_described(model, path)}"
    if error["type"] in ("model_type", "dict_type", "model_attributes_type"):
        return f"{key} = {error['input']!r}: must be a table of keys; write [{key}] with its keys below"
    if error["type"] == "literal_error":
        choices = error["ctx"]["expected"]
        hint = nearest(str(error["input"]), re.findall(r"'([^']+)'", choices), "the nearest is")
        return f"{key} = {error['input']!r}: must be {choices}{hint}"
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] in _BEYOND:
        limit, words = _BEYOND[error["type"]]
        message = f"must be {words} {error['ctx'][limit]:g}"
    if KEY in error.get("ctx", {}):
        return f"{key}: {message}"
    value = repr(error["input"])
    shown = value if len(value) <= 80 else value[:77] + "..."
    return f"{key} = {shown}: {message}" if key else message


def at_key(key: str, problem: str) -> PydanticCustomError:
    """Validation error of one key of a table."""
    return PydanticCustomError("key", "{problem}", {KEY: key, "problem": problem})


def check_once(names: Iterable[str], what: str, remedy: str) -> None:
    """Raise ValueError if two tables have the same name."""
    twice = repeated(names)
    if twice is not None:
        raise ValueError(f"{what} name {twice!r} is used twice; {remedy}")


def repeated(names: Iterable[str]) -> str | None:
    """First repeated name in alphabetical order; None without one."""
    return min((name for name, times in Counter(names).items() if times > 1), default=None)


def nearest(name: str, known: Iterable[str], words: str) -> str:
    """Hint ``; the nearest … is 'x'`` for a message; empty without ``known`` names."""
    # a longer name is not a typing error, and the time of the search grows as the square of the length
    lower = {one.casefold(): one for one in known}
    near = difflib.get_close_matches(name[: limits.NAME.default].casefold(), lower, n=1, cutoff=0.0)
    return f"; {words} {lower[near[0]]!r}" if near else ""


def _described(model: type[BaseModel], path: list[str]) -> str:
    """``: `` and the description of a key; empty without one."""
    texts = [node["properties"].get(path[-1], {}).get("description") for node in _nodes(model, path[:-1]) if "properties" in node]
    return next((f": {text}" for text in texts if text), "")


def _nodes(model: type[BaseModel], path: list[str]) -> list[dict[str, Any]]:
    """Nodes of the model's JSON Schema at ``path``."""
    schema = model.model_json_schema()
    definitions = schema.get("$defs", {})
    nodes = [schema]
    for part in [*path, ""]:
        nodes = [resolved for node in nodes for resolved in _alternatives(node, definitions)]
        if part == "":
            break
        children = []
        for node in nodes:
            if "items" in node and part.isdigit():
                children.append(node["items"])
            elif part in node.get("properties", {}):
                children.append(node["properties"][part])
            elif isinstance(node.get("additionalProperties"), dict):
                children.append(node["additionalProperties"])
        nodes = children or nodes
    return nodes


def _alternatives(node: dict[str, Any], definitions: dict[str, Any]) -> list[dict[str, Any]]:
    if "$ref" in node:
        return _alternatives(definitions[node["$ref"].rsplit("/", 1)[-1]], definitions)
    if "anyOf" in node:
        return [found for option in node["anyOf"] for found in _alternatives(option, definitions)]
    return [node]


def line_of(text: str, path: list[str]) -> int | None:
    """Number of the line that sets ``path`` or begins its table; None if it is not found."""
    wanted = [part for part in path if not part.isdigit()]
    indices = [int(part) for part in path if part.isdigit()]
    table: list[str] = []
    seen: dict[str, int] = {}
    best: tuple[int, int] | None = None
    for number, line in enumerate(text.splitlines(), 1):
        header = _HEADER.match(line)
        if header:
            table = [part.strip().strip("\"'") for part in header.group(2).split(".")]
            if header.group(1):
                seen[header.group(2)] = seen.get(header.group(2), -1) + 1
            candidate, in_item = table, not header.group(1) or not indices or seen[header.group(2)] == indices[0]
        else:
            key = _KEY.match(line)
            if not key:
                continue
            candidate = [*table, *key.group(1).split(".")]
            current = seen.get(".".join(table))
            in_item = current is None or not indices or current == indices[0]
        depth = len(candidate)
        if in_item and candidate == wanted[:depth] and (best is None or depth > best[0]):
            best = (depth, number)
    return best[1] if best else None
