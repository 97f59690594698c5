"""Workspace: everything learnt of one or several objects over their task parameters. Named by the hash of its bytes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import UInt8

from models.eigenspace import Eigenspace
from models.errors import AppearanceError
from models.sealed import Seal, under
from models.workspace.grid import Parameter
from models.workspace.learnt import LearntObject
from models.workspace.located import Located
from models.workspace.locating import Search
from models.workspace.look import Look

VERSION = 1
SEAL = Seal(
    "workspace",
    VERSION,
    AppearanceError,
    "`inspector workspace learn` makes them",
    "learn again",
    "restore it, or learn again",
)


@dataclass(frozen=True, eq=False)
class Workspace:
    """How objects look over their task parameters q.

    Made by `models.workspace.learn_workspace`. One universal eigenspace says which object it may be and about where;
    the object's own says exactly where (Murase and Nayar, IJCV 14(1), 1995). The bytes are sealed (`models.sealed`).
    """

    parameters: tuple[Parameter, ...]
    look: Look
    """How pictures are prepared. In colour where the first picture learnt from was."""
    universal: Eigenspace
    """Of the pictures of all objects."""
    learnt: tuple[LearntObject, ...]
    facts: Mapping[str, str] = field(default_factory=dict[str, str])
    """Where it comes from: number of pictures, versions of the libraries."""

    @property
    def objects(self) -> tuple[str, ...]:
        """Their names, in the order in which they were first seen."""
        return tuple(each.name for each in self.learnt)

    def reach(self, object: str) -> tuple[float, ...]:
        """How far to either side each parameter of an object was learnt: half its axis, or half its period.

        Raises NumericError where there is no such object.
        """
        g = self._search.named(object).manifold
        spans = zip(g.axes, g.periods, strict=True)
        return tuple(float(period or axis[-1] - axis[0]) / 2 for axis, period in spans)

    @cached_property
    def _search(self) -> Search:
        return Search.of(self.parameters, self.universal, self.learnt)

    def locate(self, pixels: UInt8[np.ndarray, "h w *c"]) -> Located:
        """Which object a picture (h, w) or (h, w, 3) shows, and where: over all places of all objects.

        Raises PictureError where the picture is of another size than those learnt from.
        """
        return self._search.locate(self.look.x(pixels))

    def locate_near(
        self, pixels: UInt8[np.ndarray, "h w *c"], object: str, q: tuple[float, ...], reach: tuple[float, ...]
    ) -> Located:
        """Where a picture of this object shows it, not farther than `reach` from q per parameter: for tracking.

        Raises PictureError as `locate`; NumericError where there is no such object.
        """
        near, by = np.array(q, np.float64), np.array(reach, np.float64)
        return self._search.locate_near(self.look.x(pixels), object, near, by)

    @cached_property
    def id(self) -> str:
        """Its name: `sha256:` and the hash of its bytes."""
        return "sha256:" + hashlib.sha256(self.to_bytes()).hexdigest()

    def to_bytes(self) -> bytes:
        """The same workspace always gives the same bytes."""
        arrays = {f"universal.{name}": array for name, array in self.universal.arrays().items()}
        for i, each in enumerate(self.learnt):
            arrays |= {f"{i}.{name}": array for name, array in each.arrays().items()}
        header = {
            "parameters": [[parameter.name, parameter.period] for parameter in self.parameters],
            "look": self.look.to_header(),
            "objects": [each.to_header() for each in self.learnt],
            "facts": dict(self.facts),
        }
        return SEAL.to_bytes(arrays, header)

    @classmethod
    def from_bytes(cls, data: bytes) -> Workspace:
        """Verified: raises AppearanceError for a file that is foreign, newer, cut or changed in any bit."""
        arrays, header = SEAL.opened(data)
        try:
            parameters = tuple(Parameter(str(name), period) for name, period in header["parameters"])
            objects = [
                LearntObject.from_parts(each, under(f"{i}.", arrays)) for i, each in enumerate(header["objects"])
            ]
            made = cls(
                parameters,
                Look.from_header(header["look"]),
                Eigenspace.from_arrays(under("universal.", arrays)),
                tuple(objects),
                header["facts"],
            )
            return made._checked()
        except AppearanceError:
            raise
        # a file made by hand can be wrong in more ways than can be named
        except Exception as error:
            raise AppearanceError(f"the workspace lacks what version {VERSION} holds: {error}") from error

    def _checked(self) -> Workspace:
        p = self.look.p
        spaces = {"universal": self.universal} | {each.name: each.space for each in self.learnt}
        wrong = [name for name, space in spaces.items() if space.p != p]
        wrong += [each.name for each in self.learnt if each.manifold.m != len(self.parameters)]
        if wrong or not self.learnt or len(spaces) != 1 + len(self.learnt):
            raise AppearanceError(f"the workspace does not fit together: {', '.join(wrong) or 'its objects'}")
        return self
