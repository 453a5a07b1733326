"""Check every instant of an env step: overlaps, broken limits, jumps.

Two checks of a gap are never further apart than the time in which the bodies' fastest points could close it
(conservative advancement; Mirtich 1996), so that nothing is missed.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from train.evaluation.audit import arcs as drives
from train.evaluation.audit.arcs import STAND_SPEED, STAND_STEER, body_at
from train.evaluation.audit.bodies import Outline, body_of, gap, outline_of, point_gap
from warehouse_env.kernel import inline, kernel, part
from warehouse_env.simulation.state import PERSON_RADIUS

ROBOT, SHELF, PERSON, SPEED, ACCELERATION, STEERING, STEERING_RATE, JUMP = range(8)  # kinds of faults
KINDS = ("robot", "shelf", "person", "speed", "acceleration", "steering", "steering rate", "jump")  # by their numbers
OVERLAPS, LIMITS = KINDS[:SPEED], KINDS[SPEED:JUMP]
NONE = -1
# Columns of faults float64[K, FAULT]: what and who, the other robot or person, when in the step [s], how much and where
# [m]. How much: the depth [m], what is over a limit (SI), the miss [m].
WORLD, KIND, FIRST, SECOND, TIME, SIZE, AT_X, AT_Y = range(8)
FAULT = 8

HORIZON = 0.5  # [m] beyond which gaps are not measured
_FINE = 1e-4  # [m], accuracy of the closest approach
_ALLOWED = 1e-5  # [m/s], [rad], excess over a limit by rounding
_LOOKS = 64  # samples of an overlap to find where it is deepest


class Obstacles(NamedTuple):
    """The fixed obstacles."""

    solid: Any  # bool[W, H]: shelves, by columns and rows of cells counted from x = y = 0
    discs: Any  # float64[K, 3]: x, y, radius [m] of round obstacles
    cell: float  # [m]


class EnvStep(NamedTuple):
    """One env step of all B worlds."""

    before: Any  # float64[B, N, STATE]
    after: Any  # float64[B, N, STATE]
    put_back: Any  # bool[B, N]: robots whose motion within the step is not known
    people: Any  # float64[B, M, 2] [m] as the step begins
    walked: Any  # float64[B, M, 2] [m/s], straight on


class Findings(NamedTuple):
    """The results of an audit."""

    closest: Any  # float64[B] [m], of each world so far
    ways: Any  # float64[B] [m], of each world so far
    faults: Any  # float64[K, FAULT]


class AuditScene(NamedTuple):
    """One world in one env step."""

    arcs: Any  # float64[N, pieces, ARC], see arcs.py
    people: Any  # float64[M, 2] [m] as the step begins
    walked: Any  # float64[M, 2] [m/s], straight on
    obstacles: Any  # see Obstacles
    world: int
    slack: float  # [m], rounding error of one body's place
    fleet: Any  # whose bodies, see bodies.Fleet


@inline
def _is_solid(solid, column, row):
    """Return whether a cell is a shelf; all cells beyond the rim are."""
    inside = 0 <= column < solid.shape[0] and 0 <= row < solid.shape[1]
    return not inside or solid[column, row]


@part
def _shelf_gap(x, y, c, s, scene, body):
    """Return the gap [m] between a body and the shelf or disc nearest to it, at most a cell."""
    size, half = scene.obstacles.cell, 0.5 * scene.obstacles.cell
    solid, discs = scene.obstacles.solid, scene.obstacles.discs
    own = outline_of((x, y, c, s), body)
    least, reach = size, body.radius + size
    for column in range(math.floor((x - reach) / size), math.floor((x + reach) / size) + 1):
        for row in range(math.floor((y - reach) / size), math.floor((y + reach) / size) + 1):
            if _is_solid(solid, column, row):
                at_x, at_y = (column + 0.5) * size, (row + 0.5) * size
                if point_gap(at_x - x, at_y - y, half, half) - body.radius < least:
                    least = min(least, gap(own, Outline(at_x, at_y, 1.0, 0.0, half, half)))
    for k in range(discs.shape[0]):
        dx, dy, wide = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        near = least + wide + body.radius
        if dx * dx + dy * dy < near * near:
            found = point_gap(dx * c + dy * s, dy * c - dx * s, body.half_length, body.half_width) - wide
            least = min(least, found)
    return least


@part
def gap_at(kind, i, j, t, scene):
    """Return the gap [m] at t [s] of robot i to robot or person j, or to the shelf nearest to it; negative: overlap."""
    body = body_of(i, scene.fleet)
    x, y, c, s = body_at(scene.arcs, i, t, body)
    if kind == SHELF:
        return _shelf_gap(x, y, c, s, scene, body)
    if kind == PERSON:
        dx = scene.people[j, 0] + t * scene.walked[j, 0] - x
        dy = scene.people[j, 1] + t * scene.walked[j, 1] - y
        return point_gap(dx * c + dy * s, dy * c - dx * s, body.half_length, body.half_width) - PERSON_RADIUS
    other = body_of(j, scene.fleet)
    to_x, to_y, to_c, to_s = body_at(scene.arcs, j, t, other)
    dx, dy = to_x - x, to_y - y
    circles = math.sqrt(dx * dx + dy * dy) - (body.radius + other.radius)
    if circles > HORIZON:
        return circles
    return gap(outline_of((x, y, c, s), body), outline_of((to_x, to_y, to_c, to_s), other))


@part
def first_overlap(kind, i, j, speed, end, least, scene):
    """Return (when [s] two bodies first overlap within a step, or NONE; the least gap [m] until then).

    speed: of any two of their points past each other, at the most [m/s]; end: what of the step is looked at [s], 0 for
    its beginning alone; least: the least gap [m] of interest, found to _FINE.
    """
    t, deep = 0.0, 2.0 * scene.slack  # an overlap is more than what rounding makes of two
    while True:
        found = gap_at(kind, i, j, t, scene)
        least = min(least, found)
        if found < -deep:
            return t, least
        sure = found - max(least - _FINE, -2.0 * deep)  # by which the gap may shrink without interest
        if sure >= speed * (end - t):
            return float(NONE), least
        t += sure / speed


@inline
def _deepest(kind, i, j, t, end, scene):
    """Return the depth [m] of an overlap that begins at t [s], and the place of its first robot where it is deepest."""
    depth, at = -np.inf, t
    for look in range(_LOOKS + 1):
        now = t + (end - t) * look / _LOOKS
        deep = -gap_at(kind, i, j, now, scene)
        if deep > depth:
            depth, at = deep, now
    x, y, _, _ = body_at(scene.arcs, i, at, body_of(i, scene.fleet))
    return depth, x, y


@inline
def _note(faults, count, fault):
    """Write a fault if there is room; return the number of faults."""
    if count < faults.shape[0]:
        f = faults[count]
        f[WORLD], f[KIND], f[FIRST], f[SECOND], f[TIME], f[SIZE], f[AT_X], f[AT_Y] = fault
    return min(count + 1, faults.shape[0])


@part
def _look(faults, count, pair, speed, end, least, scene):
    """Look for an overlap of two bodies in a step, and write the fault; return (faults, least gap [m]).

    pair: (kind, i, j) as for `gap_at`; speed, end, least: as for `first_overlap`.
    """
    kind, i, j = pair
    t, least = first_overlap(kind, i, j, speed, end, least, scene)
    if t != NONE:
        depth, x, y = _deepest(kind, i, j, t, end, scene)
        least = min(least, -depth)
        count = _note(faults, count, (scene.world, kind, i, j, t, depth, x, y))
    return count, least


@inline
def _within(knot, first, last, rate, before, after):
    """Return the value nearest to a knot that is reachable from `first` and from which `last` is reachable."""
    low, high = max(first - rate * before, last - rate * after), min(first + rate * before, last + rate * after)
    return min(max(knot, low - _ALLOWED), high + _ALLOWED)


@part
def trace(arc, before, after, slack, body):
    """Write the arcs of a robot's step; return (JUMP, ACCELERATION, STEERING_RATE or NONE, by how much).

    Where no motion fits, the robot is taken to stand.
    """
    speed, steer = 0.5 * (before[STAND_SPEED] + after[STAND_SPEED]), 0.5 * (before[STAND_STEER] + after[STAND_STEER])
    if drives.size(drives.lay(arc, before, after, speed, steer, body), body) <= slack:
        return NONE, 0.0
    speed, steer = drives.solve(arc, before, after, slack, body)
    early = body.pieces // 2 * body.piece
    late = body.pieces * body.piece - early
    fair = _within(speed, before[STAND_SPEED], after[STAND_SPEED], body.acceleration, early, late)
    fair = min(max(fair, body.slowest - _ALLOWED), body.fastest + _ALLOWED)
    turned = _within(steer, before[STAND_STEER], after[STAND_STEER], body.steering_rate, early, late)
    turned = min(max(turned, -body.steering - _ALLOWED), body.steering + _ALLOWED)
    miss = drives.size(drives.lay(arc, before, after, fair, turned, body), body)
    if miss <= slack:
        return NONE, 0.0
    if drives.size(drives.lay(arc, before, after, speed, steer, body), body) > slack:
        drives.stand(arc, before)
        return JUMP, miss
    faster, further = abs(speed - fair) / early, abs(steer - turned) / early
    return (ACCELERATION, faster) if faster > further else (STEERING_RATE, further)


@inline
def _check_limits(faults, count, world, i, before, after, put_back, body):
    """Write the limits that a robot's step breaks; return the number of faults."""
    x, y, end = after[0], after[1], body.pieces * body.piece
    speed, steer = after[STAND_SPEED], after[STAND_STEER]
    over = max(speed - body.fastest, body.slowest - speed)
    if over > _ALLOWED:
        count = _note(faults, count, (world, SPEED, i, NONE, end, over, x, y))
    if abs(steer) - body.steering > _ALLOWED:
        count = _note(faults, count, (world, STEERING, i, NONE, end, abs(steer) - body.steering, x, y))
    over = abs(speed - before[STAND_SPEED]) - body.acceleration * end
    if over > _ALLOWED and not put_back:
        count = _note(faults, count, (world, ACCELERATION, i, NONE, end, over / end, x, y))
    over = abs(steer - before[STAND_STEER]) - body.steering_rate * end
    if over > _ALLOWED and not put_back:
        count = _note(faults, count, (world, STEERING_RATE, i, NONE, end, over / end, x, y))
    return count


@kernel
def _drive_all(faults, count, before, after, put_back, seen, end, scene):
    """Write all robots' arcs and their faults; return the number of faults and the metres driven.

    seen float64[4, N]: where the centre is as the step begins [m], the greatest speed of a point [m/s], and how long
    the motion is known [s]; end [s]: of the step.
    """
    way, world = 0.0, scene.world
    for i in range(before.shape[0]):
        arc, body = scene.arcs[i], body_of(i, scene.fleet)
        seen[3, i] = end
        if put_back[i]:
            drives.stand(arc, before[i])
            seen[3, i] = 0.0
        else:
            kind, over = trace(arc, before[i], after[i], scene.slack, body)
            if kind != NONE:
                count = _note(faults, count, (world, kind, i, NONE, end, over, after[i, 0], after[i, 1]))
            if kind == JUMP:
                seen[3, i] = 0.0
        count = _check_limits(faults, count, world, i, before[i], after[i], put_back[i], body)
        x, y, _, _ = body_at(scene.arcs, i, 0.0, body)
        seen[0, i], seen[1, i], seen[2, i] = x, y, drives.top_speed(arc, body)
        way += drives.driven(arc, body)
    return count, way


@kernel
def _look_at_pairs(faults, count, seen, least, end, scene):
    """Write which robots overlap; return (faults, the least gap of two [m], at most `least`).

    Robots are checked from west to east, each against those that its circle and their motion may reach.
    """
    order = np.argsort(seen[0])
    apart = 2.0 * scene.fleet.radius + min(least, HORIZON)
    most = seen[2].max() * end
    for n in range(order.size):
        i = order[n]
        for m in range(n + 1, order.size):
            j = order[m]
            speed = seen[2, i] + seen[2, j]
            if seen[0, j] - seen[0, i] > apart + seen[2, i] * end + most:
                break
            if abs(seen[1, j] - seen[1, i]) <= apart + speed * end:
                known = min(seen[3, i], seen[3, j])
                pair = (ROBOT, min(i, j), max(i, j))
                count, least = _look(faults, count, pair, speed, known, least, scene)
    return count, least


@kernel
def _look_around(faults, count, seen, end, scene):
    """Write which robots overlap shelves or people; return the number of faults."""
    for i in range(seen.shape[1]):
        speed, body = seen[2, i], body_of(i, scene.fleet)
        count, _ = _look(faults, count, (SHELF, i, NONE), speed, seen[3, i], -np.inf, scene)
        for j in range(scene.people.shape[0]):
            pace = math.sqrt(scene.walked[j, 0] ** 2 + scene.walked[j, 1] ** 2)
            dx, dy = scene.people[j, 0] - seen[0, i], scene.people[j, 1] - seen[1, i]
            near = body.radius + PERSON_RADIUS + (speed + pace) * end
            if dx * dx + dy * dy <= near * near:
                count, _ = _look(faults, count, (PERSON, i, j), speed + pace, seen[3, i], -np.inf, scene)
    return count


@kernel
def audit_step(step, obstacles, fleet, findings):
    """Check one env step of all worlds and update the findings; return how many faults were written."""
    worlds, robots = step.before.shape[:2]
    faults, closest = findings.faults, findings.closest
    count, seen, body = 0, np.empty((4, robots)), fleet.bodies[0]  # which all divide an env step alike
    end = body.pieces * body.piece
    arcs = np.empty((robots, body.pieces, drives.ARC))
    slack = drives.rounding(max(obstacles.solid.shape) * obstacles.cell, body)
    for b in range(worlds):
        scene = AuditScene(arcs, step.people[b], step.walked[b], obstacles, b, slack, fleet)
        count, way = _drive_all(faults, count, step.before[b], step.after[b], step.put_back[b], seen, end, scene)
        findings.ways[b] += way
        count, closest[b] = _look_at_pairs(faults, count, seen, closest[b], end, scene)
        count = _look_around(faults, count, seen, end, scene)
    return count
