"""Who touches whom: trial motion, exact contact, put-back, and the episodes that are counted.

All robots move at once; whoever runs into something is put back to the substep's start with zero speed, and this
is repeated until nothing overlaps: at worst all stand where they stood. So no body ever overlaps another.
A contact episode begins with a touch and ends when the gap is wider than `near_miss_gap`: a robot that keeps
pushing another is counted once, however often it is put back. A near miss is a gap under `near_miss_gap` that
opened again untouched.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.simulation.buckets import bucket_at
from warehouse_env.simulation.footprint import body_touches_shelf
from warehouse_env.simulation.geometry import rectangle_gap, rectangles_touch
from warehouse_env.simulation.kernel import inline
from warehouse_env.simulation.kinematics import drive
from warehouse_env.simulation.state import GAP_HORIZON
from warehouse_env.simulation.trigonometry import ZERO, sin_cos

_HORIZON = np.float32(GAP_HORIZON)
NEAR, CONTACT = 1, 2  # status of a pair: near and untouched, in a contact episode; 0 = apart


@inline
def list_pairs(robots, heads, nexts, side, p, pairs):  # type: ignore[no-untyped-def]
    """Write the pairs (i, j, touched = 0), j < i, that could come near within a physics step; return their number."""
    count = 0
    reach = p["pair_range"]
    offset = p["offset"]
    for i in range(robots.shape[0]):
        r = robots[i]
        cx, cy = r["x"] - offset * r["cos"], r["y"] - offset * r["sin"]
        row, column = bucket_at(cx, cy, heads, side)
        for by in range(max(row - 1, 0), min(row + 2, heads.shape[0])):
            for bx in range(max(column - 1, 0), min(column + 2, heads.shape[1])):
                j = heads[by, bx]
                while j >= 0:
                    if j < i:
                        o = robots[j]
                        dx = o["x"] - offset * o["cos"] - cx
                        dy = o["y"] - offset * o["sin"] - cy
                        if dx * dx + dy * dy < reach * reach and count < pairs.shape[0]:
                            pairs[count, 0] = i
                            pairs[count, 1] = j
                            pairs[count, 2] = 0
                            count += 1
                    j = nexts[j]
    return count


@inline
def try_motion(r, p):  # type: ignore[no-untyped-def]
    """Move one robot for a substep, on trial: the try_ fields; speed and steering change for good."""
    speed, steer = r["speed"], r["steer"]
    next_speed = min(max(speed + r["acceleration"] * p["dt"], p["min_speed"]), p["max_speed"])
    next_steer = min(max(steer + r["steer_rate"] * p["dt"], -p["max_steer"]), p["max_steer"])
    r["steer"] = next_steer
    r["speed"] = next_speed
    if speed == ZERO and next_speed == ZERO:
        r["moving"] = 0
        stay(r)
        return
    r["moving"] = 1
    x, y, heading = drive(r["x"], r["y"], r["heading"], speed, next_speed, steer, next_steer, p["wheelbase"], p["dt"])
    r["try_x"], r["try_y"], r["try_heading"] = x, y, heading
    r["try_sin"], r["try_cos"] = sin_cos(heading)


@inline
def stay(r):  # type: ignore[no-untyped-def]
    """Make the trial pose the present one."""
    r["try_x"], r["try_y"], r["try_heading"] = r["x"], r["y"], r["heading"]
    r["try_cos"], r["try_sin"] = r["cos"], r["sin"]


@inline
def _put_back(r):  # type: ignore[no-untyped-def]
    stay(r)
    r["moving"] = 0
    r["blocked"] = 0
    r["speed"] = ZERO


@inline
def keep_off_shelves(robots, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Put back the robots whose trial pose touches a shelf."""
    for i in range(robots.shape[0]):
        r = robots[i]
        if r["moving"] != 0:
            c, s = r["try_cos"], r["try_sin"]
            cx, cy = r["try_x"] - p["offset"] * c, r["try_y"] - p["offset"] * s
            if body_touches_shelf(cx, cy, c, s, p["half_length"], p["half_width"], solid, clearance, p["cell"]):
                _put_back(r)
                r["touching"] = 1
                if r["shelf_contact"] == 0:
                    r["hit_shelf"] += 1
                r["shelf_contact"] = 1


@inline
def _tried_bodies_touch(r, o, p):  # type: ignore[no-untyped-def]
    """Whether the trial poses of two robots touch."""
    dx = (o["try_x"] - p["offset"] * o["try_cos"]) - (r["try_x"] - p["offset"] * r["try_cos"])
    dy = (o["try_y"] - p["offset"] * o["try_sin"]) - (r["try_y"] - p["offset"] * r["try_sin"])
    reach = p["radius"] + p["radius"]
    return dx * dx + dy * dy <= reach * reach and rectangles_touch(
        dx, dy, r["try_cos"], r["try_sin"], p["half_length"], p["half_width"],
        o["try_cos"], o["try_sin"], p["half_length"], p["half_width"],
    )  # fmt: skip


@inline
def _runs_into(r, o, p):  # type: ignore[no-untyped-def]
    """Whether robot r's trial pose touches robot o where o stood: then r is at fault, whatever o does."""
    dx = (o["x"] - p["offset"] * o["cos"]) - (r["try_x"] - p["offset"] * r["try_cos"])
    dy = (o["y"] - p["offset"] * o["sin"]) - (r["try_y"] - p["offset"] * r["try_sin"])
    return rectangles_touch(
        dx, dy, r["try_cos"], r["try_sin"], p["half_length"], p["half_width"],
        o["cos"], o["sin"], p["half_length"], p["half_width"],
    )  # fmt: skip


@inline
def keep_off_robots(robots, pairs, count, p):  # type: ignore[no-untyped-def]
    """Put back the robots whose trial poses touch, at once, again and again until none do.

    Of two that touch, the one that ran into where the other stood is put back, so that nobody is held by a robot
    that pushes it; both are if both did, or if they met half-way.
    """
    again = True
    while again:
        again = False
        for k in range(count):
            r, o = robots[pairs[k, 0]], robots[pairs[k, 1]]
            if (r["moving"] == 0 and o["moving"] == 0) or not _tried_bodies_touch(r, o, p):
                continue
            first, second = _runs_into(r, o, p), _runs_into(o, r, p)
            if first or not second:
                r["blocked"] = r["moving"]
            if second or not first:
                o["blocked"] = o["moving"]
            pairs[k, 2] = 1
            again = True
        if again:
            for i in range(robots.shape[0]):
                if robots[i]["blocked"] != 0:
                    _put_back(robots[i])


@inline
def accept_motion(robots):  # type: ignore[no-untyped-def]
    """Make the trial poses the real ones, and add up the distance driven."""
    for i in range(robots.shape[0]):
        r = robots[i]
        if r["moving"] != 0:
            dx, dy = r["try_x"] - r["x"], r["try_y"] - r["y"]
            way = np.sqrt(dx * dx + dy * dy)
            r["driven"] += way
            r["distance"] += np.float64(way)
            r["x"], r["y"], r["heading"] = r["try_x"], r["try_y"], r["try_heading"]
            r["cos"], r["sin"] = r["try_cos"], r["try_sin"]


@inline
def judge_pairs(robots, pairs, count, stamps, clock, p):  # type: ignore[no-untyped-def]
    """Measure the gaps, and begin and end contact episodes and near misses.

    stamps int32[N, N]: 4 x clock + status of a pair when it was last near, so that nothing must be cleared.
    """
    offset = p["offset"]
    reach = p["radius"] + p["radius"] + _HORIZON
    for k in range(count):
        i, j = pairs[k, 0], pairs[k, 1]
        r, o = robots[i], robots[j]
        dx = (o["x"] - offset * o["cos"]) - (r["x"] - offset * r["cos"])
        dy = (o["y"] - offset * o["sin"]) - (r["y"] - offset * r["sin"])
        if dx * dx + dy * dy > reach * reach:
            continue
        gap = rectangle_gap(
            dx, dy, r["cos"], r["sin"], p["half_length"], p["half_width"],
            o["cos"], o["sin"], p["half_length"], p["half_width"],
        )  # fmt: skip
        if pairs[k, 2] != 0:
            gap = ZERO
        r["gap"] = min(r["gap"], gap)
        o["gap"] = min(o["gap"], gap)
        stamp = stamps[i, j]
        before = stamp & 3 if stamp >> 2 == clock - 1 else 0
        now = before
        if pairs[k, 2] != 0:
            r["touching"] = 1
            o["touching"] = 1
            now = CONTACT
            if before != CONTACT:
                r["hit_robot"] += 1
                o["hit_robot"] += 1
        elif gap >= p["near_miss_gap"]:
            now = 0
            if before == NEAR:
                r["near_miss"] += 1
                o["near_miss"] += 1
        elif before == 0:
            now = NEAR
        if now != 0:
            stamps[i, j] = 4 * clock + now


@inline
def end_shelf_contacts(robots, p, solid, clearance):  # type: ignore[no-untyped-def]
    """A shelf episode ends when the body, widened by near_miss_gap, is free again."""
    wide = p["near_miss_gap"]
    for i in range(robots.shape[0]):
        r = robots[i]
        if r["shelf_contact"] != 0:
            c, s = r["cos"], r["sin"]
            cx, cy = r["x"] - p["offset"] * c, r["y"] - p["offset"] * s
            if not body_touches_shelf(
                cx, cy, c, s, p["half_length"] + wide, p["half_width"] + wide, solid, clearance, p["cell"]
            ):
                r["shelf_contact"] = 0
