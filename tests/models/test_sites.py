"""Sites: spread over all that a sweep shows, each followed while it is in view."""

from __future__ import annotations

import numpy as np

from models.sites import beside, sites, visit, way
from tests.models.parts import SIZE, golden

SPACING = SIZE[0] / 7


def test_whatever_the_camera_sees_a_site_is_near() -> None:
    at, found = way(golden()), sites(golden(), SPACING)
    points = np.array([(site.x, site.y) for site in found]) - at[[site.place for site in found]]
    first, last = np.array([(site.first, site.last) for site in found]).T
    for place in range(0, len(at), 11):
        seen = (first <= place) & (place < last)
        for x in range(4, SIZE[0], 19):
            for y in range(4, SIZE[1], 19):
                assert np.hypot(*(points[seen] + at[place] - (x, y)).T).min() <= 1.3 * SPACING


def test_a_site_is_in_view_as_long_as_it_says_and_no_longer() -> None:
    at = way(golden())
    for site in sites(golden(), SPACING)[::5]:
        ways = at - at[site.place] + (site.x, site.y)
        inside = (ways >= 0).all(axis=1) & (ways <= np.array(SIZE) - 1).all(axis=1)
        assert inside[site.first : site.last].all()
        assert site.first <= site.place < site.last
        middle = np.hypot(*(ways[site.first : site.last] - np.array(SIZE) / 2).T)
        assert middle[site.place - site.first] <= middle.min() + 1e-4


def test_where_nothing_moves_nothing_is_followed_for_ever() -> None:
    site = visit(np.zeros((400, 2)), SIZE, 200, (30.0, 40.0), reach=50, keys=np.arange(0, 400, 8))
    assert (site.place, site.first, site.last, site.depth) == (200, 150, 251, 30.0)


def test_material_is_put_beside_the_nearest_edge_that_is_strong_enough() -> None:
    site = sites(golden(), SPACING)[10]
    found = beside(golden(), site, room=25, within=SPACING, reach=6, bright=True)
    assert found is not None
    assert np.hypot(found.x - site.x, found.y - site.y) <= SPACING
    assert beside(golden(), site, room=250, within=SPACING, reach=6, bright=True) is None
