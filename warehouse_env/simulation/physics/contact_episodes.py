"""Count contact episodes and near misses of pairs of robots, and contact episodes with shelves.

A contact episode begins with a touch and ends when the gap exceeds `near_miss_gap`. So a robot that keeps pushing
counts once. A near miss is a gap under `near_miss_gap` that opens again without a touch.
"""

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.physics.contact import body_in
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import body_of, grown, rectangle_gap, squared_distance
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.trigonometry import ZERO
from warehouse_env.simulation.state import GAP_HORIZON

_HORIZON = np.float32(GAP_HORIZON)
NEAR, CONTACT = 1, 2  # status of a pair: near and untouched, in a contact episode; 0 = apart


@inline
def _known(stamps, j, clock):
    """Return (the slot of robot j, its last status, 0 if it was not near).

    The first free slot is taken, so behind a slot that was never taken there are none.
    """
    free = -1
    for slot in range(stamps.shape[0]):
        age = clock - (stamps[slot, 1] >> 2)
        if age == 1 and stamps[slot, 0] == j:
            return slot, stamps[slot, 1] & 3
        never = stamps[slot, 1] == 0
        if (age > 1 or never) and free < 0:
            free = slot
        if never:
            break
    return max(free, 0), 0


@inline
def judge_pairs(robots, motion, pairs, count, stamps, clock, p, kinds):
    """Measure the gaps; begin and end contact episodes and near misses.

    stamps int32[N, K, 2]: for each pair in which a robot comes first, the other's number, and 4 x clock + status when
    they were last near, so that nothing must be cleared. K: see state.most_near.
    """
    for k in range(count):
        i, j = pairs[k, 0], pairs[k, 1]
        one, other = kind_of(i, p, kinds), kind_of(j, p, kinds)
        reach = one["radius"] + other["radius"] + _HORIZON
        body, other_body = body_in(motion, i, one), body_in(motion, j, other)
        if squared_distance(body, other_body) > reach * reach:
            continue
        gap = rectangle_gap(body, other_body)
        r, o = robots[i], robots[j]
        events = r["events"]
        if pairs[k, 2] != 0:
            gap = ZERO
        events["gap"] = min(events["gap"], gap)
        o["events"]["gap"] = min(o["events"]["gap"], gap)
        slot, before = _known(stamps[i], j, clock)
        now = before
        if pairs[k, 2] != 0:
            events["touching"] = 1
            o["events"]["touching"] = 1
            now = CONTACT
            if before != CONTACT:
                events["hit_robot"] += 1
                o["events"]["hit_robot"] += 1
        elif gap >= p["near_miss_gap"]:
            now = 0
            if before == NEAR:
                events["near_miss"] += 1
                o["events"]["near_miss"] += 1
        elif before == 0:
            now = NEAR
        if now != 0:
            stamps[i, slot, 0], stamps[i, slot, 1] = j, 4 * clock + now


@inline
def end_shelf_contacts(robots, p, kinds, floor):
    """End shelf episodes of bodies that, widened by near_miss_gap, are free again."""
    wide = p["near_miss_gap"]
    for i in range(robots.shape[0]):
        r = robots[i]
        motion = r["motion"]
        if r["events"]["shelf_contact"] != 0:
            body = grown(body_of(motion["x"], motion["y"], motion["cos"], motion["sin"], kind_of(i, p, kinds)), wide)
            if not body_touches_shelf(body, floor):
                r["events"]["shelf_contact"] = 0
