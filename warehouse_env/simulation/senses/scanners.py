"""The safety scanners of a robot: one at each corner of its body, 270 degrees each.

Two at opposite corners see all round in the open, but not beside a body half-way into an aisle. Two robots are said
to see each other if one's scanner sees the other's: a line of sight is one from both its ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.buckets import SEARCH, bucket_at
from warehouse_env.simulation.physics.contact import COS, SIN, X, Y
from warehouse_env.simulation.physics.edges import Edges
from warehouse_env.simulation.physics.footprint import meets_obstacle
from warehouse_env.simulation.physics.geometry import Rectangle, body_at, grown, rectangles_touch
from warehouse_env.simulation.physics.people import RADIUS, scan_people
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, TWO_PI, ZERO, arc_tan2
from warehouse_env.simulation.senses.sensing import scan_robot, scan_shelves

SCANNERS = 4
RAYS = 360  # of each, evenly all round
AHEAD = np.array([1, -1, 1, -1], dtype=np.float32)  # of the centre, or behind: opposite corners first
LEFT = np.array([1, -1, -1, 1], dtype=np.float32)


class Scanners(NamedTuple):
    """Static arrays of the scanners of one config on one map."""

    rays: NDArray[np.float32]  # [2, R], unit vectors in the robot's frame
    edges: Edges


def unit_vectors(rays: int) -> NDArray[np.float32]:
    """Return float32[2, rays]: the directions of rays, evenly all round, in the robot's frame."""
    angles = 2 * np.pi * np.arange(rays) / rays
    return np.stack([np.cos(angles), np.sin(angles)]).astype(np.float32)


_RAYS, _APART = 5, np.float32(0.45)  # rays by which a disc is looked for, this part of its radius from each other
_CORNER = np.float32(1.5)  # of the way between two rays that a body's right angle reaches before it meets one
_SKIN = np.float32(1e-3)  # [m] of its own body that a line of sight may graze


@inline
def centre_of(i, motion, p):
    """Return the centre [m] of robot i's body."""
    return motion[X, i] - p["offset"] * motion[COS, i], motion[Y, i] - p["offset"] * motion[SIN, i]


@inline
def scanner_at(i, k, motion, p):
    """Return where scanner k of robot i is [m]."""
    c, s = motion[COS, i], motion[SIN, i]
    x, y = centre_of(i, motion, p)
    ahead, left = AHEAD[k] * p["half_length"], LEFT[k] * p["half_width"]
    return x + ahead * c - left * s, y + ahead * s + left * c


@part
def scan(i, persons, motion, places, walking, p, scanners, scratch):
    """Write how far robot i's scanners see along each of their rays [m] into the second of `scratch`.

    scratch: turned float32[TURNED, R], ranges float32[SCANNERS, R]. Rays into its own body see nothing.
    """
    order, starts, _ = places
    rays, edges = scanners
    turned, ranges = scratch
    c, s, columns = motion[COS, i], motion[SIN, i], p["bucket_columns"]
    x, y = centre_of(i, motion, p)
    row, column = bucket_at(x, y, p)
    left, right = max(column - SEARCH, 0), min(column + SEARCH + 1, columns)
    for k in range(SCANNERS):
        ox, oy = scanner_at(i, k, motion, p)
        out = ranges[k]
        scan_shelves((ox, oy, c, s), p, edges, rays, turned, out)
        for by in range(max(row - SEARCH, 0), min(row + SEARCH + 1, p["bucket_rows"])):
            for n in range(starts[by * columns + left], starts[by * columns + right]):
                j = order[n]
                dx, dy = centre_of(j, motion, p)
                dx, dy = dx - ox, dy - oy
                reach = p["lidar_range"] + p["radius"]
                if j != i and dx * dx + dy * dy < reach * reach:
                    oc, os = motion[COS, j], motion[SIN, j]
                    scan_robot(dx * c + dy * s, dy * c - dx * s, oc * c + os * s, os * c - oc * s, p, rays, out)
        if walking is not None:
            scan_people(persons, (ox, oy, c, s), walking, rays, out)
        for n in range(rays.shape[1]):
            out[n] = ZERO if AHEAD[k] * rays[0, n] < ZERO and LEFT[k] * rays[1, n] < ZERO else out[n]


@part
def _is_clear(sight, pair, persons, motion, places, walking, p, floor):
    """Whether nothing is in the line of sight (x, y, x, y) [m] from a scanner of one robot of a pair to the other's."""
    ax, ay, bx, by = sight
    order, starts, _ = places
    dx, dy = bx - ax, by - ay
    length = np.sqrt(dx * dx + dy * dy)
    if length == ZERO:
        return True
    c, s, half, columns = dx / length, dy / length, HALF * length, p["bucket_columns"]
    mx, my = ax + HALF * dx, ay + HALF * dy
    line = Rectangle(mx, my, c, s, half, ZERO)
    if meets_obstacle(line, floor):
        return False
    row, column = bucket_at(mx, my, p)
    left, right = max(column - SEARCH, 0), min(column + SEARCH + 1, columns)
    for at in range(max(row - SEARCH, 0), min(row + SEARCH + 1, p["bucket_rows"])):
        for n in range(starts[at * columns + left], starts[at * columns + right]):
            k = order[n]
            x, y = centre_of(k, motion, p)
            skin = _SKIN if k in pair else ZERO
            if rectangles_touch(line, grown(body_at(x, y, motion[COS, k], motion[SIN, k], p), -skin)):
                return False
    if walking is not None:
        for o in persons:
            along = min(max((o["x"] - ax) * c + (o["y"] - ay) * s, ZERO), length)
            x, y = ax + along * c - o["x"], ay + along * s - o["y"]
            if x * x + y * y <= RADIUS * RADIUS:
                return False
    return True


@part
def see_each_other(i, j, persons, motion, places, walking, p, floor):
    """Whether a scanner of robot i sees one of robot j, or, what is the same, the other way round; i < j."""
    for k in range(SCANNERS):
        ax, ay = scanner_at(i, k, motion, p)
        for m in range(SCANNERS):
            bx, by = scanner_at(j, m, motion, p)
            dx, dy = bx - ax, by - ay
            near = dx * dx + dy * dy <= p["lidar_range"] * p["lidar_range"]
            if near and _is_clear((ax, ay, bx, by), (i, j), persons, motion, places, walking, p, floor):
                return True
    return False


@inline
def sees_all(x, y, radius, i, motion, p, ranges):
    """Whether one of robot i's scanners surely sees all of the disc at (x, y) [m]."""
    count = ranges.shape[1]
    per_turn = np.float32(count) / TWO_PI
    c, s = motion[COS, i], motion[SIN, i]
    for k in range(SCANNERS):
        ox, oy = scanner_at(i, k, motion, p)
        dx, dy = x - ox, y - oy
        distance = np.sqrt(dx * dx + dy * dy)
        if distance <= radius + radius:
            continue
        at = arc_tan2(dy * c - dx * s, dx * c + dy * s) * per_turn
        beyond = distance + radius + _CORNER * distance / per_turn  # a corner may stick out between two rays
        half = np.float32(1.2) * radius / distance * per_turn + ONE  # of at most half a right angle, and the ray beyond
        sees = True
        for n in range(int(np.floor(at - half)), int(np.ceil(at + half)) + 1):
            if ranges[k, n % count] <= beyond:
                sees = False
                break
        if sees:
            return True
    return False


@inline
def sees_disc(x, y, radius, i, motion, p, ranges):
    """Whether a ray of robot i's scanners runs into the disc at (x, y) [m]: then nothing fills it."""
    count = ranges.shape[1]
    per_turn = np.float32(count) / TWO_PI
    c, s = motion[COS, i], motion[SIN, i]
    for k in range(SCANNERS):
        ox, oy = scanner_at(i, k, motion, p)
        dx, dy = x - ox, y - oy
        squared = dx * dx + dy * dy
        if squared <= radius * radius:
            return True
        distance = np.sqrt(squared)
        angle = arc_tan2(dy * c - dx * s, dx * c + dy * s)
        half = radius / distance  # a little less than the angle that the disc fills to either side
        for n in range(_RAYS):
            side = (n + 1) // 2 if n % 2 == 1 else -(n // 2)  # the middle of the disc first
            off = np.float32(side) * _APART * half
            ray = int(np.floor((angle + off) * per_turn + HALF))
            off = np.float32(ray) / per_turn - angle
            aside = distance * off  # at least how far from the disc's centre the ray passes
            if abs(aside) < radius:
                if ray < 0:
                    ray += count
                if ray >= count:
                    ray -= count
                if ranges[k, ray] > distance - np.sqrt(radius * radius - aside * aside):
                    return True
    return False
