"""A detectability map in words, and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from inspector.files import write_new
from models.defects import Kind
from models.detectability import Detectability, Stretch

_MOST = 12
"""Stretches that are told one by one."""


def source(found: Detectability) -> str:
    """What the defects were put into."""
    if found.sweeps:
        return "one golden recording" if found.sweeps == 1 else f"{found.sweeps} golden recordings"
    return "the learnt reference pictures, which have no noise"


def middle(found: Detectability) -> float:
    """The contrast that is told first."""
    return found.contrasts[len(found.contrasts) // 2]


def px(size: float) -> str:
    """A size for people."""
    return "none" if math.isinf(size) else f"{size:g} px"


def sentences(found: Detectability) -> Iterator[str]:
    """The smallest sizes by kind and contrast, then the stretches in which less is found than elsewhere."""
    for kind in found.kinds:
        for contrast in found.contrasts:
            yield f"{kind}, {contrast:g} grey levels: {_summary(found, kind, contrast)}"
    weak = [stretch for kind in found.kinds for stretch in found.weak(kind, middle(found))]
    for stretch in sorted(weak, key=lambda each: (-each.size, each.s_start))[:_MOST]:
        yield told(found, stretch)
    if len(weak) > _MOST:
        yield f"and {len(weak) - _MOST} more weak stretches: see the JSON"


def told(found: Detectability, stretch: Stretch) -> str:
    """One stretch in a sentence."""
    what = f"no {stretch.kind} of {stretch.contrast:g} grey levels"
    where = f"between s = {stretch.s_start:.2f} and {stretch.s_end:.2f}"
    if math.isinf(stretch.size):
        return f"{where} {what} is caught, up to {max(found.sizes):g} px"
    return f"{where} {what} below {stretch.size:g} px is caught"


def _summary(found: Detectability, kind: Kind, contrast: float) -> str:
    sizes = found.at(kind, contrast)
    tried = found.inner & ~np.isnan(sizes)
    if not tried.any():
        return "nowhere an edge that strong"
    worst = int(np.flatnonzero(tried)[sizes[tried].argmax()])
    site = found.sites[worst]
    where = f"s {found.s_of[worst]:.3f}, x {site.x:.0f}, y {site.y:.0f}"
    said = f"{px(found.usual(kind, contrast))} usual, {px(float(sizes[worst]))} at the worst place ({where})"
    rim = ~found.inner & ~np.isnan(sizes)
    missed = float(np.isinf(sizes[rim]).mean()) if rim.any() else 0.0
    return f"{said}; none at {missed:.0%} of the picture's rim" if missed else said


def detectability_record(found: Detectability, appearance_id: str) -> dict[str, object]:
    """Everything of a map. Sizes are in pixels; null where nothing was tried, "none" where nothing was caught."""
    return {
        "appearance_id": appearance_id,
        "recordings": found.sweeps,
        "picture": list(found.size),
        "spacing": _number(found.spacing),
        "blur": _number(found.blur),
        "astray": _number(found.astray),
        "kinds": [kind.value for kind in found.kinds],
        "contrasts": list(found.contrasts),
        "sizes": list(found.sizes),
        "weak": [
            {
                "s_start": _number(stretch.s_start),
                "s_end": _number(stretch.s_end),
                "kind": kind.value,
                "contrast": contrast,
                "size": _size(stretch.size),
            }
            for kind in found.kinds
            for contrast in found.contrasts
            for stretch in found.weak(kind, contrast)
        ],
        "along": [_along(found, kind, contrast) for kind in found.kinds for contrast in found.contrasts],
        "over_picture": [_over(found, kind, contrast) for kind in found.kinds for contrast in found.contrasts],
        "sites": [_site(found, number) for number in range(len(found.sites))],
    }


def _along(found: Detectability, kind: Kind, contrast: float) -> dict[str, object]:
    along = found.along(kind, contrast)
    three = {name: [_size(v) for v in getattr(along, name)] for name in ("best", "usual", "worst")}
    return {"kind": kind.value, "contrast": contrast, "s": [_number(v) for v in along.s], **three}


def _over(found: Detectability, kind: Kind, contrast: float) -> dict[str, object]:
    usual, worst = ([[_size(v) for v in row] for row in each] for each in found.over_picture(kind, contrast))
    return {"kind": kind.value, "contrast": contrast, "usual": usual, "worst": worst}


def _site(found: Detectability, number: int) -> dict[str, object]:
    site = found.sites[number]
    return {
        "s": _number(found.s_of[number]),
        "x": _number(site.x),
        "y": _number(site.y),
        "s_start": _number(found.s[site.first]),
        "s_end": _number(found.s[site.last - 1]),
        "rim": not found.inner[number],
        "local_contrast": _number(found.local[number]),
        "smallest": [[_size(v) for v in row] for row in found.smallest[:, :, number]],
    }


def _size(size: float) -> float | str | None:
    if math.isnan(size):
        return None
    return "none" if math.isinf(size) else _number(size)


def _number(value: float) -> float:
    return round(float(value), 6)


def write_detectability(path: Path, record: dict[str, object]) -> None:
    """The record as a new JSON file. Raises OutputExists, NotWritten."""
    write_new(path, json.dumps(record, indent=1, allow_nan=False).encode() + b"\n")
