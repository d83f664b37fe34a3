"""Frozen dataclasses with shared methods, which are created in a fraction of the standard library's time."""

from collections.abc import Callable, Iterable
from dataclasses import MISSING, FrozenInstanceError
from typing import TYPE_CHECKING, Any, Literal, TypeVar

if TYPE_CHECKING:
    from dataclasses import dataclass
else:
    import dataclasses

    Made = TypeVar("Made")

    def dataclass(*, frozen: Literal[True]) -> Callable[[type[Made]], type[Made]]:  # noqa: ARG001
        """Decorator of a class with immutable instances, as ``dataclasses.dataclass(frozen=True)``."""

        def made(plain: type[Made]) -> type[Made]:
            for name in ("__init__", "__eq__", "__hash__", "__repr__", "__setattr__", "__delattr__"):
                if name not in vars(plain):
                    setattr(plain, name, vars(_Frozen)[name])
            return dataclasses.dataclass(init=False, eq=False, repr=False)(plain)

        return made


def sliced(record: Any, names: Iterable[str], rows: slice) -> dict[str, Any]:
    """Rows of the fields ``names`` of a record, by name; None for a field that is None."""
    return {name: None if (whole := getattr(record, name)) is None else whole[rows] for name in names}


class _Frozen:
    """Methods of all frozen dataclasses."""

    __dataclass_fields__: dict[str, Any]

    def __init__(self, *args: object, **given: object) -> None:
        own, fields = self.__dict__, self.__dataclass_fields__
        own.update(zip(fields, args, strict=False))
        if len(args) > len(fields) or not own.keys().isdisjoint(given) or not given.keys() <= fields.keys():
            raise TypeError(f"{type(self).__qualname__} takes {', '.join(fields)}, each once")
        own.update(given)
        for name in fields.keys() - own.keys() if len(own) < len(fields) else ():
            item = fields[name]
            if item.default is MISSING and item.default_factory is MISSING:
                raise TypeError(f"{type(self).__qualname__} needs {name}")
            own[name] = item.default if item.default_factory is MISSING else item.default_factory()
        if (then := getattr(self, "__post_init__", None)) is not None:
            then()

    def __eq__(self, other: object) -> bool:
        return _compared(self) == _compared(other) if type(self) is type(other) else NotImplemented

    def __hash__(self) -> int:
        return hash(_compared(self))

    def __repr__(self) -> str:
        shown = (f"{name}={getattr(self, name)!r}" for name, item in self.__dataclass_fields__.items() if item.repr)
        return f"{type(self).__qualname__}({', '.join(shown)})"

    def __setattr__(self, name: str, value: object) -> None:
        own = self.__dict__
        if name in own or name not in self.__dataclass_fields__:
            raise FrozenInstanceError(f"cannot assign to field {name!r}")
        own[name] = value

    def __delattr__(self, name: str) -> None:
        raise FrozenInstanceError(f"cannot delete field {name!r}")


def _compared(record: Any) -> tuple[Any, ...]:
    return tuple(getattr(record, name) for name, item in record.__dataclass_fields__.items() if item.compare)


__all__ = ["dataclass", "sliced"]
