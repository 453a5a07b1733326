"""Where paths meet, by lists of the poses in each square, against every pose held against every other."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.simulation.reference import separation
from tests.simulation.rights import World, rectangles
from warehouse_env.simulation.traffic.path_ahead import COS, POSES, SIN
from warehouse_env.simulation.traffic.reservations import (
    COUNT,
    CROSS,
    NEARBY,
    TIGHT,
    TOUCH_TIGHT,
    TOUCH_WIDE,
    WHO,
    WIDE,
    ReservationTable,
    enlist,
    meet,
    scratch,
)

PARAMETERS = World((5.0, 5.0, 0.0)).simulator._params[0]
CLOSE = 1e-4  # [m] within which rounding may decide
poses = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.1, 3.1))
paths = st.lists(st.lists(poses, min_size=1, max_size=POSES), min_size=2, max_size=5)


def near(k: int, m: int) -> bool:
    """Whether two poses are so near in time that they are held against each other with TIGHT room alone."""
    return k == 0 or m == 0 or (k <= NEARBY and m <= NEARBY)


@settings(max_examples=60)
@given(drawn=paths, data=st.data())
def test_all_poses_that_touch_are_found_and_no_others(
    drawn: list[list[tuple[float, float, float]]], data: st.DataObject
) -> None:
    kept = np.zeros((len(drawn) + 1, POSES, 5), np.float32)
    for path, given_poses in zip(kept, drawn, strict=False):
        for pose, (x, y, heading) in zip(path, given_poses, strict=False):
            pose[:4] = x, y, np.cos(heading), np.sin(heading)
    table = ReservationTable(kept, *scratch(len(kept) - 1))
    table.numbers[COUNT, :-1] = [len(path) for path in drawn]
    enlist(table, PARAMETERS)
    mine = data.draw(st.integers(0, len(drawn) - 1))
    last = data.draw(st.integers(0, len(drawn[mine]) - 1))
    count = meet(mine, mine, last, table, PARAMETERS, None)
    masks, met = table.masks, table.numbers[WHO, :count].tolist()
    assert len(set(met)) == count
    for other in range(len(drawn)):
        if other == mine:
            assert other not in met
            continue
        own, theirs = kept[mine, : last + 1], kept[other, : len(drawn[other])]
        wide = separation(rectangles(own, WIDE)[:, None], rectangles(theirs, WIDE)[None])
        tight = separation(rectangles(own, TIGHT)[:, None], rectangles(theirs, TIGHT)[None])
        across = own[:, [COS, SIN]] @ theirs[:, [COS, SIN]].T
        for k in range(last + 1):
            for m in range(len(theirs)):
                touch = (tight if near(k, m) else wide)[k, m]
                if abs(touch) < CLOSE or abs(tight[k, m]) < CLOSE or abs(across[k, m] - 0.5) < CLOSE:
                    continue
                if other not in met:
                    assert touch > 0
                    continue
                bits = [bool(masks[which, met.index(other), k] >> m & 1) for which in (TOUCH_WIDE, TOUCH_TIGHT, CROSS)]
                assert bits == [touch < 0, tight[k, m] < 0, bool(touch < 0 and across[k, m] < 0.5)], (other, k, m)


def test_floors_larger_than_the_squares_go_on_from_the_first() -> None:
    kept = np.zeros((3, POSES, 5), np.float32)
    kept[:, :, COS] = 1.0
    kept[0, 0, :2], kept[1, 0, :2] = (200.0, 300.0), (200.5, 300.0)
    table = ReservationTable(kept, *scratch(len(kept) - 1))
    table.numbers[COUNT, :-1] = 1
    enlist(table, PARAMETERS)
    assert meet(0, 0, 0, table, PARAMETERS, None) == 1
    kept[1, 0, :2] = 200.0 + 64 * 2.0, 300.0
    enlist(table, PARAMETERS)
    assert meet(0, 0, 0, table, PARAMETERS, None) == 0
