"""Drawn parts seen from places that are known: what the tests of workspaces learn from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import cv2
import numpy as np

from models.workspace import LabelledPicture
from tests.models.parts import surface

VIEW = (96, 72)


def view(part: np.ndarray, x: float, y: float = 0.0, turn_deg: float = 0.0, gain: float = 1.0) -> np.ndarray:
    """The part's middle, the camera moved by (x, y) pixels and turned."""
    width, height = VIEW
    turned = cv2.getRotationMatrix2D((width / 2, height / 2), turn_deg, 1.0)
    turned[:, 2] += np.array([part.shape[1] / 2 + x, part.shape[0] / 2 + y]) - np.array([width, height]) / 2
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpAffine(part, turned, VIEW, flags=flags, borderMode=cv2.BORDER_REFLECT)
    return np.clip(gain * seen, 0, 255).astype(np.uint8)


def pictures(axes: Sequence[Sequence[float]], seeds: Sequence[int] = (1,)) -> Iterator[LabelledPicture]:
    """Of parts `part1`, `part2`, ... on a grid of x, y, turn, or of the first of these."""
    for seed in seeds:
        for q in product(*axes):
            yield LabelledPicture(f"part{seed}", q, view(surface(seed), *q))
