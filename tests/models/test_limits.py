"""Limits: the threshold is a floor and a share of the contrast, times what golden sweeps reached."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from models.limits import Limits
from tests.models.parts import MANY

CONTRASTS = st.lists(st.floats(0, 255), min_size=2, max_size=9).map(np.array)


@given(contrast=CONTRASTS, floor=st.floats(0.5, 20), share=st.floats(0, 1), factor=st.floats(0.2, 9))
@MANY
def test_the_threshold_is_linear_in_the_contrast(contrast: np.ndarray, floor: float, share: float, factor: float):
    found = Limits(floor, share, factor).threshold(contrast)
    np.testing.assert_allclose(found, [factor * (floor + share * c) for c in contrast])


@given(contrast=CONTRASTS)
@MANY
def test_the_usual_threshold_is_positive_and_grows_with_the_contrast(contrast: np.ndarray):
    found = Limits().threshold(np.sort(contrast))
    assert np.all(found > 0)
    assert np.all(np.diff(found) >= 0)
