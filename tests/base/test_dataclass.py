"""Frozen records: what the standard library's are, and never set twice."""

import copy
import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, asdict, field, fields, replace
from dataclasses import dataclass as of_library
from functools import cached_property
from typing import Any

import pytest

from massprop_cli.base.dataclass import dataclass


@dataclass(frozen=True)
class Ours:
    """One."""

    mass: float
    names: tuple[str, ...] = ()
    hidden: list[int] = field(default_factory=list, repr=False, compare=False)

    @cached_property
    def twice(self) -> float:
        return 2 * self.mass


@of_library(frozen=True)
class Theirs:
    """The same by the library."""

    mass: float
    names: tuple[str, ...] = ()
    hidden: list[int] = field(default_factory=list, repr=False, compare=False)


@dataclass(frozen=True)
class Heavier(Ours):
    """With a field more, checked as it is made."""

    bearing: float = 0.0

    def __post_init__(self) -> None:
        if self.bearing < 0:
            raise ValueError("negative")


def test_they_show_compare_and_hash_as_the_librarys_do() -> None:
    assert repr(Ours(1.0, ("a",), [3])) == repr(Theirs(1.0, ("a",), [3])).replace("Theirs", "Ours")
    assert Ours(1.0, ("a",), [3]) == Ours(1.0, ("a",))
    assert Ours(1.0) != Ours(2.0)
    other: object = Theirs(1.0)
    assert Ours(1.0) != other
    assert Ours(1.0) != Heavier(1.0)
    assert hash(Ours(1.0, ("a",))) == hash(Theirs(1.0, ("a",)))
    assert {Ours(1.0), Ours(1.0)} == {Ours(1.0)}


@pytest.mark.parametrize(
    "change", [lambda one: setattr(one, "mass", 2.0), lambda one: setattr(one, "other", 2.0), lambda one: delattr(one, "mass")]
)
def test_nothing_of_them_changes(change: Callable[[Any], None]) -> None:
    one = Ours(1.0)
    with pytest.raises(FrozenInstanceError):
        change(one)
    assert one == Ours(1.0)
    assert not hasattr(one, "other")


def test_what_reads_the_librarys_reads_them() -> None:
    one = Ours(1.0, ("a",))
    assert [item.name for item in fields(one)] == ["mass", "names", "hidden"]
    assert asdict(one) == {"mass": 1.0, "names": ("a",), "hidden": []}
    assert replace(one, mass=3.0) == Ours(3.0, ("a",))
    assert one.twice == 2.0
    assert pickle.loads(pickle.dumps(one)) == copy.deepcopy(one) == one


def test_one_that_inherits_keeps_its_fields_and_checks_itself() -> None:
    assert Heavier(1.0, bearing=2.0).bearing == 2.0
    with pytest.raises(ValueError, match="negative"):
        replace(Heavier(1.0), bearing=-1.0)


@pytest.mark.parametrize(("args", "given"), [((), {}), ((1.0, (), [], 4), {}), ((1.0,), {"mass": 2.0}), ((1.0,), {"weight": 2.0})])
def test_a_field_is_given_once_and_is_one_of_them(args: tuple[Any, ...], given: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match="Ours"):
        Ours(*args, **given)
