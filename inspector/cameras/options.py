"""The options of a camera's url: a frozen dataclass says name, default and what is allowed; `read` fills it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, fields
from math import inf, isfinite
from typing import Any, TypeVar

from inspector.cameras.base import OptionRefused, UnknownOption

Options = TypeVar("Options")


def number(default: float, low: float = -inf, high: float = inf) -> Any:
    """A real number, `low` and `high` included."""
    return _option(default, float, lambda v: isfinite(v) and low <= v <= high, "a number" + _range(low, high))


def whole(default: int, low: float = -inf, high: float = inf) -> Any:
    """A whole number, `low` and `high` included."""
    return _option(default, int, lambda v: low <= v <= high, "a whole number" + _range(low, high))


def flag(default: bool = False) -> Any:
    """Yes or no, written 1 or 0."""
    words = {"1": True, "true": True, "yes": True, "0": False, "false": False, "no": False}
    return _option(default, lambda text: words[text.lower()], lambda _: True, "0 or 1")


def choice(default: str, *known: str) -> Any:
    """One word of those known."""
    return _option(default, str, lambda v: v in known, "one of " + ", ".join(known))


def words(default: str, read: Callable[[str], Any], allowed: str) -> Any:
    """Anything that `read` understands (a ValueError or KeyError says no)."""
    return _option(read(default), read, lambda _: True, allowed)


def numbers(text: str, count: int | None = None) -> tuple[float, ...]:
    """Finite numbers between commas: exactly `count` of them, or any number when None."""
    values = tuple(float(part) for part in text.split(",")) if text else ()
    if not all(isfinite(v) for v in values) or (count is not None and len(values) != count):
        raise ValueError(text)
    return values


def read(camera: str, kind: type[Options], query: Mapping[str, str]) -> Options:
    """`kind` filled from the query. Raises UnknownOption, or OptionRefused with the value and what is allowed."""
    known: dict[str, Any] = {f.name: f for f in fields(kind)}  # pyright: ignore[reportArgumentType]
    values: dict[str, Any] = {}
    for name, text in query.items():
        if name not in known:
            raise UnknownOption(camera, name, tuple(known))
        rule = known[name].metadata
        try:
            values[name] = rule["read"](text)
        except (ValueError, KeyError):
            raise OptionRefused(camera, name, text, rule["allowed"]) from None
        if not rule["check"](values[name]):
            raise OptionRefused(camera, name, text, rule["allowed"])
    return kind(**values)


def _option(default: Any, reader: Callable[[str], Any], check: Callable[[Any], bool], allowed: str) -> Any:
    return field(default=default, metadata={"read": reader, "check": check, "allowed": allowed})


def _range(low: float, high: float) -> str:
    if high < inf:
        return f" from {low:g} to {high:g}"
    return f" of at least {low:g}" if low > -inf else ""
