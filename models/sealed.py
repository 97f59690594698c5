"""Arrays and one JSON header as bytes that say what they are, and that no bit of them is wrong."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from safetensors.numpy import load, save

from models.errors import NumericError

_HASH = 32
Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class Seal:
    """A kind of bytes: a tag, a version, the SHA-256 of what follows, and a safetensors archive, which holds no code.

    >>> seal = Seal("shelf", 1, NumericError, "shelves are made elsewhere", "make it again", "make it again")
    >>> data = seal.to_bytes({"heights": np.array([1.0, 2.5])}, {"colour": "red"})
    >>> seal.opened(data)
    ({'heights': array([1. , 2.5])}, {'colour': 'red'})
    >>> seal.opened(data[:-1])
    Traceback (most recent call last):
    models.errors.NumericError: the shelf is damaged: its checksum does not fit; make it again
    """

    name: str
    """For sentences, and of the header in the archive."""
    version: int
    error: type[NumericError]
    foreign: str
    """What to say of bytes of another kind; of another version; of damaged ones."""
    other: str
    damaged: str

    @property
    def tag(self) -> bytes:
        """What the bytes begin with."""
        return b"sweep-" + self.name.encode()

    def to_bytes(self, arrays: Mapping[str, np.ndarray], header: Mapping[str, object]) -> bytes:
        """The same arrays and header always give the same bytes."""
        text = json.dumps(header, sort_keys=True, separators=(",", ":"))
        payload = save({name: np.ascontiguousarray(array) for name, array in arrays.items()}, {self.name: text})
        return self.tag + self.version.to_bytes(4, "little") + hashlib.sha256(payload).digest() + payload

    def opened(self, data: bytes) -> tuple[Arrays, dict[str, Any]]:
        """Arrays and header. Raises `error` for bytes that are foreign, newer, older, cut or changed in any bit."""
        start = len(self.tag) + 4
        if data[: len(self.tag)] != self.tag:
            raise self.error(f"not {self._one}: it does not begin as one; {self.foreign}")
        version = int.from_bytes(data[len(self.tag) : start], "little")
        if version != self.version:
            raise self.error(
                f"the {self.name} has format version {version}, this program reads {self.version}: {self.other}"
            )
        payload = data[start + _HASH :]
        if hashlib.sha256(payload).digest() != data[start : start + _HASH]:
            raise self.error(f"the {self.name} is damaged: its checksum does not fit; {self.damaged}")
        try:
            size = int.from_bytes(payload[:8], "little")
            header = json.loads(json.loads(payload[8 : 8 + size])["__metadata__"][self.name])
            return load(payload), dict(header)
        # whatever bytes made by hand do to those who read them
        except Exception as error:
            raise self.error(f"the {self.name} cannot be read: {error}") from error

    @property
    def _one(self) -> str:
        return f"{'an' if self.name[0] in 'aeiou' else 'a'} {self.name}"


def under(prefix: str, arrays: Mapping[str, np.ndarray]) -> Arrays:
    """Those whose name begins so, by the rest of it."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
