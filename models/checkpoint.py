"""Checkpoint: an inspection in the middle of a sweep as bytes; gone on with, it says the same to the last bit.

What was said of the frames so far is handed apart, and so are the pictures that are kept of a doubtful beginning: a
running inspection adds to both and changes neither, so that they need be saved once only. The rest is small, and all
that scoring carries from frame to frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from models.appearance import Appearance
from models.beginning import Beginning
from models.encoder import Reading
from models.errors import CheckpointError
from models.fixture import Fixture
from models.frame import Frame
from models.inspection import Inspection, begin
from models.localise import Trail
from models.persistence import PLACES, Sight
from models.position import Places
from models.scoring import Memory
from models.sealed import Arrays, Seal
from models.verdict import Policy, ScoredFrame

VERSION = 1
SEAL = Seal(
    "checkpoint",
    VERSION,
    CheckpointError,
    "only a running inspection makes them",
    "it cannot be gone on with here",
    "it cannot be gone on with",
)


def to_bytes(inspection: Inspection) -> bytes:
    """Of an inspection between two frames; sealed (`models.sealed`).

    Without `inspection.frames`, without the appearance, which is named, and without the pictures of
    `inspection.beginning.kept`. The same inspection always gives the same bytes.
    """
    beginning, memory = inspection.beginning, inspection.memory
    arrays = _trail_arrays(memory.trail) | _sight_arrays(memory.sights)
    if beginning.last is not None:
        arrays["last"] = beginning.last
    header = {
        "appearance_id": inspection.appearance.id,
        "policy": asdict(inspection.policy),
        "frames": inspection.count,
        "chain": inspection.chain.hex(),
        "dropped": inspection.dropped,
        "last_sequence": inspection.last_sequence,
        "t_ns": memory.t_ns,
        "trail": _trail_header(memory.trail),
        "sights": [[sight.place, *([cells.start, cells.stop] for cells in sight.shown)] for sight in memory.sights],
        "beginning": {
            "agreed": beginning.agreed,
            "kept": [frame.sequence for frame in beginning.kept],
            "counted": beginning.counted,
            "confirmed": beginning.confirmed,
        },
    }
    return SEAL.to_bytes(arrays, header)


def from_bytes(
    appearance: Appearance, data: bytes, frames: Sequence[ScoredFrame], kept: Sequence[Frame] = ()
) -> Inspection:
    """The inspection as it was: `frames` are what was said so far, `kept` begins with the pictures it had kept.

    Raises CheckpointError for bytes that are foreign, newer, cut or changed in any bit, for those of another
    appearance, and where frames or pictures are not those that the inspection had.
    """
    arrays, header = SEAL.opened(data)
    if header.get("appearance_id") != appearance.id:
        raise CheckpointError(
            f"the checkpoint is of appearance {header.get('appearance_id')}, allowed is the given one: {appearance.id}"
        )
    try:
        inspection = begin(appearance, Policy(**header["policy"]))
        for scored in frames:
            inspection = inspection.with_scored(scored)
        if inspection.count != header["frames"] or inspection.chain.hex() != header["chain"]:
            raise CheckpointError(
                f"the {inspection.count} scored frames given are not the {header['frames']} of the checkpoint"
            )
        return replace(
            inspection,
            memory=Memory(
                _trail(appearance, header["trail"], arrays), _sights(appearance, header, arrays), header["t_ns"]
            ),
            beginning=_beginning(appearance, header["beginning"], arrays, kept),
            dropped=int(header["dropped"]),
            last_sequence=header["last_sequence"],
        )
    except CheckpointError:
        raise
    # bytes made by hand can be wrong in more ways than can be named
    except Exception as error:
        raise CheckpointError(f"the checkpoint lacks what version {VERSION} holds: {error}") from error


def _trail_arrays(trail: Trail) -> Arrays:
    places = trail.places
    arrays = {"places": np.stack([places.cost, places.at, places.pace])}
    if trail.fixture is not None:
        arrays |= {"mean": trail.fixture.mean, "covariance": trail.fixture.covariance}
    if trail.light is not None:
        arrays["light"] = trail.light
    return arrays


def _trail_header(trail: Trail) -> dict[str, object]:
    return {
        "unseen": trail.places.unseen,
        "residual": trail.residual,
        "agreement": trail.agreement,
        "misses": trail.misses,
        "rivalry": trail.rivalry,
        "waited": trail.waited,
        "strange": trail.strange,
        "reading": None if trail.reading is None else asdict(trail.reading),
    }


def _trail(appearance: Appearance, header: Mapping[str, Any], arrays: Arrays) -> Trail:
    cost, at, pace = _taken(arrays, "places", (3, appearance.places))
    fixture = None
    if "mean" in arrays:
        fixture = Fixture(_taken(arrays, "mean", (5,)), _taken(arrays, "covariance", (5, 5)))
    return Trail(
        Places(cost, at, pace, header["unseen"]),
        fixture,
        _taken(arrays, "light", (4,)) if "light" in arrays else None,
        header["residual"],
        header["agreement"],
        header["misses"],
        header["rivalry"],
        header["waited"],
        header["strange"],
        None if header["reading"] is None else Reading(**header["reading"]),
    )


def _sight_arrays(sights: tuple[Sight, ...]) -> Arrays:
    if not sights:
        return {}
    # map by map: what lies side by side in one is alike, which compression likes
    maps = np.stack([np.moveaxis(sight.score, 2, 0) for sight in sights])
    arrays = {
        "points": np.stack([sight.point for sight in sights]),
        "grids": np.stack([sight.grid for sight in sights]),
        "scores": maps,
    }
    unseen = [sight.unseen for sight in sights if sight.unseen is not None]
    return arrays | ({"unseen": np.stack(unseen)} if unseen else {})


def _sights(appearance: Appearance, header: Mapping[str, Any], arrays: Arrays) -> tuple[Sight, ...]:
    told = header["sights"]
    count = len(told)
    if not count:
        return ()
    if count > PLACES:
        raise CheckpointError(f"the checkpoint holds {count} sights, allowed are {PLACES}")
    rows, cols, c = appearance.references.cells
    maps = _taken(arrays, "scores", (count, c, rows, cols), "f")
    points, grids = _taken(arrays, "points", (count, 2)), _taken(arrays, "grids", (count, 2))
    unseen: list[np.ndarray | None] = [None] * count
    if appearance.ignored.mask is not None:
        unseen = [*_taken(arrays, "unseen", (count, rows, cols), "b")]
    return tuple(
        Sight(
            points[i],
            place,
            grids[i],
            np.ascontiguousarray(np.moveaxis(maps[i], 0, 2)),
            (slice(*down), slice(*across)),
            unseen[i],
        )
        for i, (place, down, across) in enumerate(told)
    )


def _beginning(appearance: Appearance, header: Mapping[str, Any], arrays: Arrays, kept: Sequence[Frame]) -> Beginning:
    wanted = header["kept"]
    given = [frame.sequence for frame in kept[: len(wanted)]]
    if given != wanted:
        raise CheckpointError(f"the pictures given are of frames {given}, the checkpoint keeps those of {wanted}")
    last, size = arrays.get("last"), appearance.references.template_size
    if last is not None and last.shape != (size[1], size[0]):
        raise CheckpointError(f"the checkpoint's last picture is {last.shape}, allowed is {(size[1], size[0])}")
    return replace(
        Beginning.of(appearance),
        agreed=tuple(header["agreed"]),
        kept=tuple(kept[: len(wanted)]),
        counted=header["counted"],
        confirmed=header["confirmed"],
        last=None if last is None else last.copy(),
    )


def _taken(arrays: Arrays, name: str, shape: tuple[int, ...], kind: str = "f") -> np.ndarray:
    array = arrays[name]
    if array.shape != shape or array.dtype.kind != kind:
        raise CheckpointError(
            f"the checkpoint's {name} has shape {array.shape} of {array.dtype}, allowed is {shape} of this appearance"
        )
    return array.copy()
