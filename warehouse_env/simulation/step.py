"""The batched step: `advance` commands, moves, judges contacts and goes on along the routes; `observe` looks.

With right of way, `agree` (agreement.py) goes before, and `make_room` (making_room.py) where rings are to be dissolved;
`seek` (rejoin.py) follows where robots seek a manoeuvre. They are five, not one, since a kernel is compiled again in
whatever calls it. Each does one world after another; for all threads, the Simulator hands out parts of the worlds.

What a config has not is not compiled: `Features` are True or None, and Numba leaves out what is done `if walking is not
None`, say, where that is None.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import inline, kernel
from warehouse_env.observation import EGO, FIELD, GOAL, NEIGHBOUR
from warehouse_env.simulation.driver import arrival, line, tracking
from warehouse_env.simulation.physics import buckets, contact, contact_episodes, deviation, people, zones
from warehouse_env.simulation.physics.edges import Edges
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.kinematics import approach, braking
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO
from warehouse_env.simulation.senses import prediction, sensing
from warehouse_env.simulation.senses.rewards import write_terms
from warehouse_env.simulation.state import GAP_HORIZON, NOBODY
from warehouse_env.simulation.traffic import audit, by_sight, field, right_of_way, waits

_HORIZON = np.float32(GAP_HORIZON)


class Features(NamedTuple):
    """What a config has: True, or None where it has not."""

    followed: Literal[True] | None  # actions are commands to the path follower, not raw
    stopping: Literal[True] | None  # robots arrive at their goals when they stand there (driver/arrival.py)
    walking: Literal[True] | None  # people
    guarded: Literal[True] | None  # the protective field
    checked: Literal[True] | None  # and looked for faults (audit.py)
    erring: Literal[True] | None  # bodies that are not quite where their robots have planned to be (deviation.py)

    @classmethod
    def of(cls, config: EnvConfig) -> Features:
        """Return the features of a config."""
        field = config.traffic_spec.shield
        checked = field and audit.is_wanted()
        stopping = config.arrival != "pass"
        has = (config.action_type != "raw", stopping, config.people > 0, field, checked, deviation.errs(config))
        return cls(*(True if one else None for one in has))


@inline
def _begin(r):
    """Clear the events of the last env step."""
    r["acting"] = r["alive"]
    r["progress"] = ZERO
    r["driven"] = ZERO
    r["gap"] = _HORIZON
    r["arrived"] = 0
    r["touching"] = 0
    r["held"] = 0
    r["held_by"] = NOBODY
    r["hit_robot"] = 0
    r["hit_shelf"] = 0
    r["hit_person"] = 0
    r["near_miss"] = 0
    r["previous_speed"] = r["target_speed"]
    r["previous_steer"] = r["target_steer"]


@inline
def _take_raw(r, acceleration, steer_rate, p):
    """Return a raw command [m/s^2], [rad/s] as it is, of a robot that is not parked."""
    if r["alive"] == 0:
        return braking(r["speed"], p), ZERO
    r["target_speed"] = r["speed"] + acceleration * p["time_step"]
    r["target_steer"] = r["steer"] + steer_rate * p["time_step"]
    return acceleration, steer_rate


@inline
def _follow(r, route, arcs, first, second, stopping, p, floor):
    """Turn a speed [m/s] and an offset [m] into (acceleration [m/s^2], steering rate [rad/s]) for a physics step."""
    if r["alive"] == 0:
        return braking(r["speed"], p), ZERO
    dt = p["time_step"]
    if p["right_of_way"] != 0 and r["settled"] > ZERO:
        first, second = right_of_way.limit(r, first, p), r["side"]
    tracking.follow(r, route, arcs, first, second, stopping, p, floor)
    next_speed = approach(r["speed"], r["target_speed"], p["max_acceleration"] * dt)
    next_steer = approach(r["steer"], r["target_steer"], p["max_steer_rate"] * dt)
    return (next_speed - r["speed"]) / dt, (next_steer - r["steer"]) / dt


@inline
def _slowed(r, acceleration, own):
    """Return a raw acceleration [m/s^2] that speeds a robot up no more than its load lets it."""
    speed, most = r["speed"], own["max_acceleration"]
    if speed * acceleration < ZERO:
        return acceleration
    fastest = max((own["max_speed"] - speed) / own["time_step"], ZERO)
    return min(max(acceleration, -most), min(most, fastest))


@inline
def _park(r, p):
    """Take a robot out of service: at once, but under the field it brakes first, as the others count on."""
    r["alive"] = 0
    if p["field"] == 0:
        r["speed"] = ZERO


@inline
def _end(r, route, stopping, p):
    """Advance along the route after a physics step; return 1 on arrival."""
    if r["alive"] == 0:
        return 0
    r["progress"] += line.locate(r, route)
    waits.count_time(r, p["time_step"])
    r["lived"] += 1
    r["age"] += 1
    if r["arrived"] != 0:
        return 0
    if stopping is not None:
        if not arrival.is_there(r, p):
            return 0
    else:
        dx, dy = r["goal_x"] - r["x"], r["goal_y"] - r["y"]
        if dx * dx + dy * dy > p["arrival_radius"] * p["arrival_radius"]:
            return 0
    r["arrived"] = 1
    if p["one_shot"] != 0:
        _park(r, p)
    return 1


@inline
def _total(r, p):
    """Add the env step's events to the episode's totals; park a robot that a collision ends."""
    r["hits_robot"] += r["hit_robot"]
    r["hits_shelf"] += r["hit_shelf"]
    r["hits_person"] += r["hit_person"]
    r["near_misses"] += r["near_miss"]
    r["min_gap"] = min(r["min_gap"], r["gap"])
    if p["collision_ends"] != 0 and r["hit_robot"] + r["hit_shelf"] + r["hit_person"] > 0:
        _park(r, p)


@kernel
def _sights(p):
    """Return scratch of sensing.py and prediction.py: turned float32[TURNED, R], legs and path."""
    turned = np.empty((sensing.TURNED, p["rays"]), np.float32)
    legs = np.empty((prediction.LEGS, p["route_points"]), np.float32)
    return turned, legs, np.empty(prediction.PATH, np.float32)


@inline
def _move(robots, persons, near, motions, walking, guarded, p, kinds, floor):
    """Carry out the motions of one physics step, but for those that would end in a shelf, a person or another robot."""
    pairs, motion, flags, lanes = motions
    for _ in range(p["substeps"]):
        contact.try_motion(motion, flags, lanes, p, kinds)
        contact.keep_off_shelves(robots, motion, flags, guarded, p, kinds, floor)
        if walking is not None:
            people.keep_off_people(robots, persons, motion, flags, p, kinds)
        contact.keep_off_robots(motion, flags, pairs, near, guarded, p, kinds)
        contact.accept_motion(robots, motion)


@inline
def _choose(
    robots, persons, routes, arcs, commands, limits, places, motions, guards, followed, stopping, walking, guarded,
    scanners, sights, looks, slow, p, kinds, floor,
):  # fmt: skip
    """Choose each robot's motion of one physics step.

    limits PARAMETERS[N]: of each robot under its load, None where nobody carries any; kinds: without it (kinds.py);
    scanners, sights float32[N, N], looks: None without them; see scanners.py and by_sight.py; slow: zones.Zones, None
    without them.
    """
    _, motion, _, _ = motions
    for i in range(robots.shape[0]):
        first, second, unladen = commands[i, 0], commands[i, 1], kind_of(i, p, kinds)
        if slow is not None:
            most = zones.most_speed(robots[i], slow, unladen)
            if followed is not None:
                first = min(max(first, -most), most)
        if followed is not None:
            own = unladen if limits is None else limits[i]
            first, second = _follow(robots[i], routes[i], arcs[i], first, second, stopping, own, floor)
        else:
            first, second = _take_raw(robots[i], first, second, unladen)
            if limits is not None:
                first = _slowed(robots[i], first, limits[i])
        if slow is not None:
            first = zones.keep_under(robots[i], first, most, unladen)
        contact.load(robots, i, first, second, unladen, floor, motion)
    if scanners is not None:
        by_sight.guard(robots, persons, motion, guards, places, sights, looks, walking, p, floor, scanners)
    elif guarded is not None:
        field.guard(robots, persons, motion, guards, places, walking, p, kinds, floor)


@inline
def _carry_out(
    robots, persons, actual, errors, near, motions, own, walking, guarded, erring, p, kinds, true, true_kinds, floor,
):  # fmt: skip
    """Carry out the motions chosen, with bodies that err as well as they can.

    near: the number of pairs that may meet; actual BODY[N], errors, own, true, true_kinds: see deviation.py.
    """
    pairs, motion, flags, lanes = motions
    if erring is None:
        _move(robots, persons, near, motions, walking, guarded, p, kinds, floor)
        contact.store(robots, motion)
    else:
        deviation.plan(motion, flags, lanes, p, kinds)
        deviation.load(robots, actual, motion, errors, own, true, true_kinds, floor)
        _move(robots, persons, near, (pairs, own, flags, lanes), walking, None, true, true_kinds, floor)
        deviation.store(robots, actual, motion, errors, own, guarded, true, true_kinds)
    if guarded is not None:
        field.settle(robots)


@inline
def _observe_world(
    robots, persons, routes, places, sights, stopping, walking, p, kinds, rays, table, weights, edges, seen, first, out,
    terms, reward,
):  # fmt: skip
    """Write observations, reward terms and rewards of one world."""
    order, starts, bodies = places
    turned, legs, path = sights
    ego = p["rays"]
    route = ego + EGO
    near = route + 2 * p["route_points"]
    buckets.sort(robots, p, kinds, starts, order, bodies)
    for n in range(robots.shape[0]):
        i = order[n]
        r, own = robots[i], kind_of(i, p, kinds)
        row = out[i]
        cx, cy = bodies[buckets.CENTRE_X, n], bodies[buckets.CENTRE_Y, n]
        sensing.scan_shelves((cx, cy, r["cos"], r["sin"]), own, Edges(edges, seen, first), rays, turned, row)
        sensing.look_around(n, places, own, kinds, rays, row, near)
        if walking is not None:
            people.scan_people(persons, cx, cy, r["cos"], r["sin"], rays, row)
        sensing.write_neighbours(n, bodies, own, row, near)
        for k in range(p["rays"]):
            row[k] = ONE / (ONE + row[k])
        sensing.write_ego_and_route(r, routes[i], own, row, ego)
        if table is not None:
            slices = ego, route, near, near + NEIGHBOUR * p["neighbours"]
            prediction.write_predictions(row, slices, table[own["kind"]], legs, path, own)
        end = row.shape[0] - p["needs"]
        if stopping is not None:
            end -= GOAL
            arrival.observe(r, own, row, end)
        if p["field"] != 0:
            field.observe(r, own, row, end - FIELD)
        reward[i] = write_terms(r, own, weights, terms[i])


@inline
def _count_step(robots, steps, b, truncated, terminated, p):
    """Count the env step of world b, and say which of its robots it ended."""
    steps[b] += 1
    truncated[b] = steps[b] >= p["max_steps"]
    if p["one_shot"] != 0 or p["collision_ends"] != 0:
        for i in range(robots.shape[0]):
            terminated[b, i] = robots[i]["alive"] == 0


@kernel
def advance(
    begin, end, robots, routes, persons, ways, arcs, commands, stamps, steps, truncated, terminated, waiting, faults,
    actual, errors, limits, followed, stopping, walking, guarded, checked, erring, scanners, sights, slow, params,
    kinds, true_params, true_kinds, floor,
):  # fmt: skip
    """Move the worlds from `begin` to before `end` on by one env step; return (arrivals, robots that seek a manoeuvre).

    robots ROBOT[B, N]; routes float32[B, N, R, 2] [m]; persons, ways: see people.People; arcs float32[B, N,
    ARCS, 2]: their manoeuvres (manoeuvre.py); commands float32[S, B, N, 2], the latest first: speed [m/s] and offset
    [m], or raw acceleration and steering rate; stamps int32[B, N, K, 2]; steps int64[B] since the reset, truncated
    bool[B], terminated bool[B, N];
    waiting int32[B]: the arrivals of each world, whose observation waits until the Simulator has given out new tasks;
    faults int32[B, 3]: see audit.find_fault; actual BODY[B, N], errors, true_params, true_kinds: see deviation.py;
    limits PARAMETERS[B, N]: of robots under loads (loads.py), None where nobody carries any; kinds PARAMETERS[N]: of
    robots of several kinds, else None (kinds.py); followed to erring: see Features; scanners, sights float32[B, N, N]:
    see scanners.py and by_sight.py, slow: zones.Zones, None without them.
    """
    p, true = params[0], true_params[0]
    arrivals, seeking, count = 0, 0, robots.shape[1]
    places, motions, guards = buckets.scratch(count, p), contact.scratch(count, p), field.scratch(count, p)
    looks = None if scanners is None else by_sight.scratch(count, scanners)
    order, starts, bodies = places
    pairs, moved, _, _ = motions
    own = moved if erring is None else np.empty_like(moved)
    for b in range(begin, end):
        waiting[b] = 0
        if guarded is not None:
            right_of_way.rank(robots[b], guards[3])
        for i in range(count):
            _begin(robots[b, i])
        for repeat in range(p["repeat"]):
            clock = steps[b] * p["repeat"] + 1 + repeat
            buckets.sort(robots[b], p, kinds, starts, order, bodies)
            near = contact.list_pairs(bodies, order, starts, p, pairs)
            said = max(p["latency"] - repeat + p["repeat"] - 1, 0) // p["repeat"]  # env steps ago
            _choose(
                robots[b], persons[b], routes[b], arcs[b], commands[said, b], None if limits is None else limits[b],
                places, motions, guards, followed, stopping, walking, guarded, scanners,
                None if scanners is None else sights[b], looks, slow, p, kinds, floor,
            )  # fmt: skip
            _carry_out(
                robots[b], persons[b], actual[b], errors[b, repeat], near, motions, own, walking, guarded, erring, p,
                kinds, true, true_kinds, floor,
            )  # fmt: skip
            if walking is not None:
                people.walk(persons[b], ways[b], robots[b], p, kinds, floor)
            if checked is not None:
                audit.find_fault(robots[b], persons[b], clock, p, kinds, floor, faults[b])
            contact_episodes.judge_pairs(robots[b], own, pairs, near, stamps[b], clock, true, true_kinds)
            contact_episodes.end_shelf_contacts(robots[b], true, true_kinds, floor)
            if walking is not None:
                people.end_contacts(robots[b], persons[b], p, kinds)
            for i in range(count):
                waiting[b] += _end(robots[b, i], routes[b, i], stopping, p)
        for i in range(count):
            _total(robots[b, i], p)
            seeking += robots[b, i]["seeks"] != 0
        _count_step(robots[b], steps, b, truncated, terminated, p)
        arrivals += waiting[b]
    return arrivals, seeking


@kernel
def observe(
    begin, end, late, robots, routes, persons, waiting, stopping, walking, params, kinds, rays, table, weights, edges,
    seen, first, out, terms, reward,
):  # fmt: skip
    """Write observations, rewards and their terms of the worlds from `begin` to before `end`: those that are `waiting`
    if `late`, which then are no more, else all others.

    table: of the discrete actions of each kind of robots, for predictions, or None; rays, weights, edges, seen, first:
    see the Simulator; out: observations float32[B, N, D]; terms float32[B, N, T]; reward float32[B, N].
    """
    p = params[0]
    places, sights = buckets.scratch(robots.shape[1], p), _sights(p)
    for b in range(begin, end):
        if (waiting[b] != 0) == late:
            waiting[b] = 0
            _observe_world(
                robots[b], persons[b], routes[b], places, sights, stopping, walking, p, kinds, rays, table, weights,
                edges, seen, first, out[b], terms[b], reward[b],
            )  # fmt: skip
