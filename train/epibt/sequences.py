"""Sequences of motions: the candidates of a robot for the next seconds. Every sequence ends at rest.

A robot may keep the rest of its last sequence, brake, drive the next arc of a manoeuvre, follow its route at some speed
and lateral offset, or drive two arcs, forwards or backwards. Sequences are rolled out from the robot's state with the
kinematics of the simulator. The cost of a sequence is the time left to the goal from its end: back to the route, and
along the rest of it. A robot that retreats prefers to back. Where robots stop at their goals, a sequence ends as soon
as the robot stands there.
"""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import inline, part
from warehouse_env.simulation.driver.arrival import RESTS, speed_before, stands_at
from warehouse_env.simulation.driver.line import along_after, look_ahead
from warehouse_env.simulation.physics.footprint import body_touches_shelf, touches_obstacle
from warehouse_env.simulation.physics.geometry import body_at, body_of, grown
from warehouse_env.simulation.physics.kinematics import approach, braking, chassis_of, drive, next_motion
from warehouse_env.simulation.physics.sweep import Sweep
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, arc_tan2, sin_cos, wrap
from warehouse_env.simulation.tasks.shifts import slowed
from warehouse_env.simulation.traffic.path_ahead import steer_along

STAGE = 5  # physics steps from one decision to the next
_STAGES = 6  # of a sequence at most, before it brakes
FASTEST = 1.5  # [m/s] at most
KEPT, STANDS, PLANNED, _FOLLOWS, TWO_ARCS = range(5)  # kinds of sequences, the first three of which are sequences
AHEAD = 3  # the sequence that follows the route as fast and far as possible
ARC_X, ARC_Y, ARC_SPEED, ARC_STEER, ARC = range(5)  # columns of the arc that a robot drives, and their number
_COLUMNS = 7  # of a program: the kind, and two of speed [m/s], offset [m] or steering [rad], and number of stages
X, Y, COS, SIN, SWEEP = range(5)  # columns of a pose: the body's centre and heading
FIRST = 1 << 32  # [steps], rank of a robot that retreats: more than the age of any task
UNKNOWN, FREE, BLOCKED = range(3)  # whether a sequence keeps off shelves

_STILL, _ROUNDING = np.float32(1e-6), 1e-6  # [m/s] and [steps] that are rounding
_ROUTE_SPEED = np.float32(1.4)  # [m/s] at which the rest of a route is priced,
_BESIDE = np.float32(1.0)  # [s/m] beside it,
_TURN, _TURN_BACK = np.float32(0.6), np.float32(3.0)  # [s/rad] off its direction, up to a right angle and beyond it
_BACK, _AHEAD = np.float32(3.0), np.float32(12.0)  # [m] of the route around the robot to which an end may belong
_LOOK = np.float32(0.6)  # [m] ahead of which the route's direction counts
_SHELF = np.float32(1.0)  # [s] for ending nearer to a shelf than each of these: the tail swings out towards it
_NEAR_SHELF, _AT_SHELF = np.float32(0.11), np.float32(0.05)  # [m]
_BACKING = np.float32(2.0)  # [s/m], price of driving ahead during a retreat
_RIGHT_ANGLE = np.float32(0.5 * math.pi)
_ARRIVES = np.float32(-1000.0)  # cost of reaching the goal at once
_OFF = np.float32(4.0)  # times the time left where a robot stops: one askew bars the lane while it is served
_GETS_OUT = np.float32(-500.0)  # cost of the next arc of a manoeuvre; its opposite if there is none
_TURNED = np.float32(0.02)  # [rad] of steering error up to which it is driven
# [m] to shelves, more than the rounding of poses in a whole sequence; for robots that are nearer than that already
_ROOM, _LEAST_ROOM = np.float32(1e-3), np.float32(5e-5)


class Scene(NamedTuple):
    """The world in which robots choose."""

    robots: Any  # ROBOT[N]
    routes: NDArray[np.float32]  # [N, R, 2] [m]
    table: NDArray[np.float32]  # [K, 7], see programs
    params: NDArray[Any]  # PARAMETERS[N], of each robot under its load
    stops: bool  # whether robots stop at their goals
    floor: Any


class Sequences(NamedTuple):
    """K sequences of each of N robots, of T physics steps and S poses at most: a pose after each substep."""

    poses: NDArray[np.float32]  # [N, K, S, 5]; SWEEP [m]: half of what any point of the body moves before or after it
    counts: NDArray[np.int32]  # [N, K], poses; 0: not rolled out
    boxes: NDArray[np.float32]  # [N, K, 4] [m]: least x, most x, least y, most y of the body's centre
    costs: NDArray[np.float32]  # [N, K] [s]
    controls: NDArray[np.float32]  # [N, K, T, 2], acceleration [m/s^2] and steering rate [rad/s] of each step
    clear: NDArray[np.int8]  # [N, K], UNKNOWN, FREE or BLOCKED
    kept: NDArray[np.float32]  # [N, T, 2], the controls that are left of the last sequence chosen
    left: NDArray[np.int32]  # [N], their number
    arc: NDArray[np.float32]  # [N, ARC]: where it ends [m], at what speed [m/s] (0: none) and steering [rad]
    known: NDArray[np.int64]  # [N], sequences whose costs are estimated
    ranks: NDArray[np.int64]  # [N], FIRST, or the age of the task since the robot last gave way [steps]


_PACES = tuple(itertools.product((FASTEST, 0.75), (0.0, -0.35, 0.35, -0.7, 0.7), (_STAGES, 3, 1)))


def programs() -> NDArray[np.float32]:
    """Return the programs of all sequences, float32[K, 7]."""
    rows: list[tuple[float, ...]] = [(KEPT,), (STANDS,), (PLANNED,), *((_FOLLOWS, *pace) for pace in _PACES)]
    angles = [math.radians(angle) for angle in (-60, -30, 0, 30, 60)]
    for first in itertools.product((-0.5, 0.6), angles, (1, 2)):
        rows.append((TWO_ARCS, *first))
        rows += ((TWO_ARCS, *first, *then, 3) for then in itertools.product((-0.5, 0.8), angles))
    rows += ((TWO_ARCS, 0.0, 0.0, 2, speed, 0.0, 3) for speed in (-0.5, 0.8))  # first the wheels turn straight
    table = np.zeros((len(rows), _COLUMNS), np.float32)
    for row, values in zip(table, rows, strict=True):
        row[: len(values)] = values
    return table


def braking_steps(config: EnvConfig) -> int:
    """Return the physics steps in which every robot can stop, under the heaviest load."""
    steps = []
    for robot in config.bodies:
        fastest, acceleration = slowed(robot, robot.payload if config.loads else 0.0)
        steps.append(math.ceil(min(fastest, FASTEST) / (acceleration * config.time_step) - _ROUNDING))
    return max(steps)


def make_sequences(config: EnvConfig, count: int) -> Sequences:
    """Return room for `count` sequences of each robot; nothing is left of a last one."""
    robots, substeps, steps = config.num_agents, config.substeps, STAGE * _STAGES + braking_steps(config)
    each, floats = (robots, count), np.float32
    return Sequences(
        np.zeros((*each, 1 + steps * substeps, 5), floats), np.zeros(each, np.int32), np.zeros((*each, 4), floats),
        np.zeros(each, floats), np.zeros((*each, steps, 2), floats), np.zeros(each, np.int8),
        np.zeros((robots, steps, 2), floats), np.zeros(robots, np.int32), np.zeros((robots, ARC), floats),
        np.zeros(robots, np.int64), np.zeros(robots, np.int64),
    )  # fmt: skip


@inline
def _put(poses, n, x, y, heading, p):
    """Write the body at a pose of its front axle."""
    s, c = sin_cos(heading)
    pose = poses[n]
    pose[X], pose[Y], pose[COS], pose[SIN], pose[SWEEP] = x - p["offset"] * c, y - p["offset"] * s, c, s, ZERO
    if n > 0:
        before = poses[n - 1]
        dx, dy, turn = pose[X] - before[X], pose[Y] - before[Y], abs(c * before[SIN] - s * before[COS])
        moved = HALF * (np.sqrt(dx * dx + dy * dy) + p["radius"] * turn)
        pose[SWEEP], before[SWEEP] = moved, max(before[SWEEP], moved)


@inline
def body_with(pose, room, p):
    """Return the body at a pose with some room [m] around it."""
    return grown(body_at(pose[X], pose[Y], pose[COS], pose[SIN], p), room)


@inline
def _target(program, t, steer):
    """Return (speed [m/s], steering [rad] or offset [m]) that a program wants in step t; speed 0 once it brakes."""
    stage = np.float32(t // STAGE)
    if program[0] != STANDS and stage < program[3]:
        return program[1], program[2]
    if stage < program[3] + program[6]:
        return program[4], program[5]
    return ZERO, program[2] if program[0] == _FOLLOWS else steer


@inline
def _is_within(task, x, y, radius):
    """Whether a point is less than `radius` [m] away from the goal."""
    dx, dy = task["goal_x"] - x, task["goal_y"] - y
    return dx * dx + dy * dy < radius * radius


@inline
def _along_arc(arc, t, x, y, speed, steer, p):
    """Return (speed [m/s], steering [rad], whether it is over) along an arc in step t: first the wheels turn."""
    dx, dy, way = arc[ARC_X] - x, arc[ARC_Y] - y, arc[ARC_STEER]
    left = np.sqrt(dx * dx + dy * dy)
    if arc[ARC_SPEED] == ZERO or left < RESTS or t >= STAGE * _STAGES:
        return ZERO, way, speed == ZERO
    if speed == ZERO and abs(way - steer) > _TURNED:
        return ZERO, way, False
    fastest = min(abs(arc[ARC_SPEED]), speed_before(left, ZERO, abs(speed), p))
    return fastest if arc[ARC_SPEED] > ZERO else -fastest, way, False


@inline
def _command(i, k, t, along, state, scene, sequences):
    """Return (acceleration [m/s^2], steering rate [rad/s], whether it is over) of sequence k of robot i in step t.

    along: the metres [m] reached on the route; state: (x, y, heading, speed, steering).
    """
    (x, y, heading, speed, steer), program, p = state, scene.table[k], scene.params[i]
    if program[0] == PLANNED:
        wanted, way, over = _along_arc(sequences.arc[i], t, x, y, speed, steer, p)
    else:
        wanted, way = _target(program, t, steer)
        over = wanted == ZERO and speed == ZERO and np.float32(t) >= program[3] * np.float32(STAGE)
        on_route = scene.robots[i]["on_route"]
        points, spacing = on_route["points"], on_route["spacing"]
        if program[0] == _FOLLOWS and points >= 2:
            line, (s, c) = (scene.routes[i], points, spacing, np.float32(points - 1) * spacing), sin_cos(heading)
            way = steer_along(line, along, way, look_ahead(max(speed, ZERO), p), (x, y, c, s), p, scene.floor)
    step = p["time_step"]
    faster = approach(speed, min(max(wanted, p["min_speed"]), p["max_speed"]), p["max_acceleration"] * step) - speed
    return faster / step, (approach(steer, way, p["max_steer_rate"] * step) - steer) / step, over


@part
def _drive(i, k, exactly, scene, sequences):
    """Drive sequence k of robot i; return its axle's last pose (x, y, heading) and the seconds [s] to the goal, or -1.

    exactly: by substeps, and poses and controls are written; else by whole physics steps.
    """
    r, route, program, p = scene.robots[i], scene.routes[i], scene.table[k], scene.params[i]
    motion, on_route, task, chassis = r["motion"], r["on_route"], r["task"], chassis_of(p)
    x, y, heading, speed, steer = motion["x"], motion["y"], motion["heading"], motion["speed"], motion["steer"]
    points, spacing, along = on_route["points"], on_route["spacing"], on_route["position"]
    poses, n, arrives, step = sequences.poses[i, k], 1, -ONE, p["time_step"]
    substeps, dt = (p["substeps"], p["dt"]) if exactly else (1, step)
    _put(poses, 0, x, y, heading, p)
    for t in range(sequences.kept.shape[1]):
        if scene.stops and (arrives >= ZERO or stands_at(task, x, y, heading, speed, p)):
            if speed == ZERO:
                arrives = max(arrives, np.float32(n - 1) * dt)
                break
            arrives, acceleration, rate = np.float32(n - 1) * dt, braking(speed, p), ZERO
        elif k == KEPT and t < sequences.left[i]:
            acceleration, rate = sequences.kept[i, t, 0], sequences.kept[i, t, 1]
        else:
            acceleration, rate, over = _command(i, k, t, along, (x, y, heading, speed, steer), scene, sequences)
            if over:
                break
        for _ in range(substeps):
            next_speed, next_steer = next_motion(speed, steer, acceleration, rate, chassis, dt)
            x, y, heading = drive((x, y, heading), speed, next_speed, steer, next_steer, chassis, dt)
            speed, steer = next_speed, next_steer
            if exactly:
                _put(poses, n, x, y, heading, p)
            if arrives < ZERO and not scene.stops and _is_within(task, x, y, p["arrival_radius"]):
                arrives = np.float32(n) * dt
            n += 1
        if exactly:
            sequences.controls[i, k, t, 0], sequences.controls[i, k, t, 1] = acceleration, rate
        speed = ZERO if abs(speed) < _STILL else speed
        if program[0] == _FOLLOWS and points >= 2:
            along = along_after(route, points, spacing, along, max(speed, ZERO) * step, x, y)
    sequences.counts[i, k] = n if exactly else 0
    return x, y, heading, arrives


@part
def _to_go(r, route, x, y, heading):
    """Return the time [s] that is left from a pose of rest: along the route, beside it, and off its direction."""
    on_route, task = r["on_route"], r["task"]
    points, spacing = on_route["points"], on_route["spacing"]
    if points < 2:
        dx, dy = task["goal_x"] - x, task["goal_y"] - y
        return np.sqrt(dx * dx + dy * dy) / _ROUTE_SPEED
    first = max(int((on_route["position"] - _BACK) / spacing), 0)
    last = min(int((on_route["position"] + _AHEAD) / spacing) + 1, points - 1)
    nearest, least = first, np.float32(np.inf)
    for k in range(first, last + 1):
        dx, dy = route[k, 0] - x, route[k, 1] - y
        if dx * dx + dy * dy < least:
            nearest, least = k, dx * dx + dy * dy
    a = min(nearest, points - 2)
    dx, dy = x - route[a, 0], y - route[a, 1]
    ux, uy = (route[a + 1, 0] - route[a, 0]) / spacing, (route[a + 1, 1] - route[a, 1]) / spacing
    ahead = dx * ux + dy * uy
    beside = abs(ux * dy - uy * dx) if ZERO <= ahead <= spacing else np.sqrt(least)
    along = np.float32(a) * spacing + ahead
    b = max(min(int((along + _LOOK) / spacing), points - 2), 0)
    off = abs(wrap(heading - arc_tan2(route[b + 1, 1] - route[b, 1], route[b + 1, 0] - route[b, 0])))
    turn = _TURN * min(off, _RIGHT_ANGLE) + _TURN_BACK * max(off - _RIGHT_ANGLE, ZERO)
    return max(np.float32(points - 1) * spacing - along, ZERO) / _ROUTE_SPEED + _BESIDE * beside + turn


@inline
def _price(i, k, exactly, scene, sequences):
    """Drive sequence k of robot i and write its cost: where it reaches the goal, by the time until then."""
    r, p, motion = scene.robots[i], scene.params[i], scene.robots[i]["motion"]
    x, y, heading, arrives = _drive(i, k, exactly, scene, sequences)
    if k == PLANNED:
        cost = _GETS_OUT if sequences.arc[i, ARC_SPEED] != ZERO else -_GETS_OUT
    elif arrives >= ZERO:
        cost = _ARRIVES + arrives
        if scene.stops:
            cost += _OFF * _to_go(r, scene.routes[i], x, y, heading)
    else:
        if sequences.ranks[i] == FIRST:
            cost = _BACKING * ((x - motion["x"]) * motion["cos"] + (y - motion["y"]) * motion["sin"])
        else:
            cost = _to_go(r, scene.routes[i], x, y, heading)
        s, c = sin_cos(heading)
        for room in (_NEAR_SHELF, _AT_SHELF):
            if body_touches_shelf(grown(body_of(x, y, c, s, p), room), scene.floor):
                cost += _SHELF
    sequences.costs[i, k] = cost


@part
def estimate(i, last, scene, sequences):
    """Estimate the costs of the sequences of robot i before number `last` that are not known yet."""
    for k in range(sequences.known[i], last):
        _price(i, k, False, scene, sequences)
        sequences.clear[i, k] = UNKNOWN if k != KEPT else FREE
    sequences.known[i] = max(sequences.known[i], last)


@part
def roll_out(i, k, scene, sequences):
    """Write poses, box, controls and cost of sequence k of robot i, if that is not done."""
    if sequences.counts[i, k] > 0:
        return
    _price(i, k, True, scene, sequences)
    poses, box = sequences.poses[i, k], sequences.boxes[i, k]
    box[0] = box[1] = poses[0, X]
    box[2] = box[3] = poses[0, Y]
    for n in range(1, sequences.counts[i, k]):
        x, y = poses[n, X], poses[n, Y]
        box[0], box[1], box[2], box[3] = min(box[0], x), max(box[1], x), min(box[2], y), max(box[3], y)


@part
def keeps_off_shelves(i, k, scene, sequences):
    """Return whether a sequence keeps off shelves, exactly: on the whole way, where it is near one."""
    clear, poses, p, floor = sequences.clear, sequences.poses[i, k], scene.params[i], scene.floor
    if clear[i, k] == UNKNOWN:
        clear[i, k] = FREE
        room = _LEAST_ROOM if body_touches_shelf(body_with(poses[0], _ROOM, p), floor) else _ROOM
        was_near = True
        for n in range(1, sequences.counts[i, k]):
            before, pose, sweep = poses[n - 1], poses[n], poses[n, SWEEP]
            is_near = body_touches_shelf(body_with(pose, room + sweep, p), floor)
            if is_near or was_near:
                swept = Sweep(body_with(before, room, p), body_with(pose, room, p), ZERO)
                if touches_obstacle(swept, sweep + sweep, True, p, floor):
                    clear[i, k] = BLOCKED
                    break
            was_near = is_near
    return clear[i, k] == FREE
