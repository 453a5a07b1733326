"""The batched step: `advance` commands, moves, judges contacts and goes on along the routes; `observe` looks.

With right of way, `agree` (agreement.py) goes before, and `make_room` (making_room.py) where rings are to be dissolved;
`seek` (rejoin.py) follows where robots seek a manoeuvre. They are five, not one, since a kernel is compiled again in
whatever calls it. Each does one world after another; for all threads, the Simulator hands out parts of the worlds.

What a config has not is not compiled: see worlds.py.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, kernel
from warehouse_env.observation import EGO, FIELD, GOAL, NEIGHBOUR
from warehouse_env.simulation.driver import arrival, line, tracking
from warehouse_env.simulation.physics import buckets, contact, contact_episodes, deviation, people
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.kinematics import approach, braking
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO
from warehouse_env.simulation.physics.zones import keep_under, most_speed
from warehouse_env.simulation.rules import audit, by_sight, field, right_of_way, waits
from warehouse_env.simulation.senses import prediction, sensing
from warehouse_env.simulation.senses.rewards import write_terms
from warehouse_env.simulation.state import GAP_HORIZON, NOBODY
from warehouse_env.simulation.worlds import Scratch

_HORIZON = np.float32(GAP_HORIZON)


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


@kernel
def _looks(count, scanners):
    """Return the scratch of by_sight.py, None without scanners."""
    return None if scanners is None else by_sight.scratch(count, scanners)


@kernel
def _own(motion, erring):
    """Return an array for the motions of bodies that err, else that of the motions planned."""
    return motion if erring is None else np.empty_like(motion)


@inline
def _move(robots, persons, near, motions, walking, guarded, vehicles, floor):
    """Carry out the motions of one physics step, but for those that would end in a shelf, a person or another robot."""
    (p, kinds), (pairs, motion, flags, lanes) = vehicles, motions
    for _ in range(p["substeps"]):
        contact.try_motion(motion, flags, lanes, p, kinds)
        contact.keep_off_shelves(robots, motion, flags, guarded, p, kinds, floor)
        if walking is not None:
            people.keep_off_people(robots, persons, motion, flags, p, kinds)
        contact.keep_off_robots(motion, flags, pairs, near, guarded, p, kinds)
        contact.accept_motion(robots, motion)


@inline
def _choose(worlds, b, commands, scratch, features, equipment, vehicles, floor):
    """Choose the motion of each robot of world b for one physics step; commands: those in force, float32[N, 2].

    Robots under loads have limits of their own, but contact and field count on those without.
    """
    (p, kinds), zones, limits = vehicles, equipment.zones, worlds.limits
    robots, motion = worlds.robots[b], scratch.motions[1]
    for i in range(robots.shape[0]):
        first, second, unladen, most = commands[i, 0], commands[i, 1], kind_of(i, p, kinds), ZERO
        if hasattr(zones, "squares"):
            most = most_speed(robots[i], zones, unladen)
            if isinstance(features.followed, bool):
                first = min(max(first, -most), most)
        if isinstance(features.followed, bool):
            own = limits[b, i] if hasattr(limits, "shape") else unladen
            route, arcs = worlds.routes[b, i], worlds.arcs[b, i]
            first, second = _follow(robots[i], route, arcs, first, second, features.stopping, own, floor)
        else:
            first, second = _take_raw(robots[i], first, second, unladen)
            if hasattr(limits, "shape"):
                first = _slowed(robots[i], first, limits[b, i])
        if hasattr(zones, "squares"):
            first = keep_under(robots[i], first, most, unladen)
        contact.load(robots, i, first, second, unladen, floor, motion)
    if hasattr(equipment.scanners, "rays"):
        sights, walking = worlds.sights[b], features.walking
        by_sight.guard(robots, worlds.persons[b], sights, scratch, walking, p, floor, equipment.scanners)
    elif isinstance(features.guarded, bool):
        field.guard(robots, worlds.persons[b], scratch, features.walking, p, kinds, floor)


@inline
def _carry_out(worlds, at, near, scratch, features, vehicles, true, floor):
    """Carry out the motions chosen in world b, with bodies that err as well as they can.

    at: (b, which physics step of the env step it is); near: the number of pairs that may meet; vehicles, true: as
    planned, and as the bodies are (deviation.py).
    """
    b, repeat = at
    (p, kinds), (true_p, true_kinds), own = vehicles, true, scratch.own
    pairs, motion, flags, lanes = scratch.motions
    robots, persons, walking, guarded = worlds.robots[b], worlds.persons[b], features.walking, features.guarded
    if isinstance(features.erring, bool):
        actual, errors = worlds.actual[b], worlds.errors[b, repeat]
        deviation.plan(motion, flags, lanes, p, kinds)
        deviation.load(robots, actual, motion, errors, own, true_p, true_kinds, floor)
        _move(robots, persons, near, (pairs, own, flags, lanes), walking, None, true, floor)
        deviation.store(robots, actual, motion, errors, own, guarded, true_p, true_kinds)
    else:
        _move(robots, persons, near, scratch.motions, walking, guarded, vehicles, floor)
        contact.store(robots, motion)
    if isinstance(guarded, bool):
        field.settle(robots)


@inline
def _judge(worlds, b, clock, near, scratch, true, floor):
    """Judge contacts after a physics step, begin and end their episodes; true: the parameters of the bodies."""
    (p, kinds), robots = true, worlds.robots[b]
    contact_episodes.judge_pairs(robots, scratch.own, scratch.motions[0], near, worlds.stamps[b], clock, p, kinds)
    contact_episodes.end_shelf_contacts(robots, p, kinds, floor)


@inline
def _count_step(worlds, b, p):
    """Count the env step of world b, and say which of its robots it ended."""
    worlds.steps[b] += 1
    worlds.truncated[b] = worlds.steps[b] >= p["max_steps"]
    if p["one_shot"] != 0 or p["collision_ends"] != 0:
        for i in range(worlds.robots.shape[1]):
            worlds.terminated[b, i] = worlds.robots[b, i]["alive"] == 0


@inline
def _step(worlds, at, scratch, features, equipment, vehicles, true, floor):
    """Advance world b by a physics step; at: (b, which one of the env step it is)."""
    (b, repeat), (p, kinds), (order, starts, bodies) = at, vehicles, scratch.places
    robots, persons = worlds.robots[b], worlds.persons[b]
    clock = worlds.steps[b] * p["repeat"] + 1 + repeat
    buckets.sort(robots, p, kinds, starts, order, bodies)
    near = contact.list_pairs(bodies, order, starts, p, scratch.motions[0])
    said = max(p["latency"] - repeat + p["repeat"] - 1, 0) // p["repeat"]  # env steps ago
    _choose(worlds, b, worlds.commands[said, b], scratch, features, equipment, vehicles, floor)
    _carry_out(worlds, at, near, scratch, features, vehicles, true, floor)
    if isinstance(features.walking, bool):
        people.walk(persons, worlds.ways[b], robots, p, kinds, floor)
    if isinstance(features.checked, bool):
        audit.find_fault(robots, persons, clock, p, kinds, floor, worlds.faults[b])
    _judge(worlds, b, clock, near, scratch, true, floor)
    if isinstance(features.walking, bool):
        people.end_contacts(robots, persons, p, kinds)
    for i in range(robots.shape[0]):
        worlds.waiting[b] += _end(robots[i], worlds.routes[b, i], features.stopping, p)


@kernel
def advance(begin, end, worlds, features, equipment, fleet, bodies, floor):
    """Move the worlds from `begin` to before `end` on by one env step; return (arrivals, robots that seek a manoeuvre).

    worlds to floor: see worlds.py and physics/floor.py; fleet, bodies: the Vehicles as planned, and as they are.
    """
    p, true = fleet.shared[0], bodies.shared[0]
    vehicles, true_vehicles = (p, fleet.kinds), (true, bodies.kinds)
    arrivals, seeking, count = 0, 0, worlds.robots.shape[1]
    motions, guards = contact.scratch(count, p), field.scratch(count, p)
    looks, own = _looks(count, equipment.scanners), _own(motions[1], features.erring)
    scratch = Scratch(buckets.scratch(count, p), motions, guards, looks, own)
    for b in range(begin, end):
        worlds.waiting[b] = 0
        if isinstance(features.guarded, bool):
            right_of_way.rank(worlds.robots[b], guards[3])
        for i in range(count):
            _begin(worlds.robots[b, i])
        for repeat in range(p["repeat"]):
            _step(worlds, (b, repeat), scratch, features, equipment, vehicles, true_vehicles, floor)
        for i in range(count):
            _total(worlds.robots[b, i], p)
            seeking += worlds.robots[b, i]["seeks"] != 0
        _count_step(worlds, b, p)
        arrivals += worlds.waiting[b]
    return arrivals, seeking


@inline
def _observe_world(worlds, b, places, sights, features, vehicles, floor, senses):
    """Write observations, reward terms and rewards of world b."""
    (p, kinds), (order, starts, bodies), (turned, legs, path) = vehicles, places, sights
    robots, rays, (edges, seen, first) = worlds.robots[b], senses.rays, floor.edges
    ego = p["rays"]
    route = ego + EGO
    near = route + 2 * p["route_points"]
    buckets.sort(robots, p, kinds, starts, order, bodies)
    for n in range(robots.shape[0]):
        i = order[n]
        r, own = robots[i], kind_of(i, p, kinds)
        row = worlds.observation[b, i]
        cx, cy = bodies[buckets.CENTRE_X, n], bodies[buckets.CENTRE_Y, n]
        sensing.scan_shelves(cx, cy, r["cos"], r["sin"], own, edges, seen, first, rays, turned, row)
        sensing.look_around(n, bodies, order, starts, own, kinds, rays, row, near)
        if isinstance(features.walking, bool):
            people.scan_people(worlds.persons[b], cx, cy, r["cos"], r["sin"], rays, row)
        sensing.write_neighbours(n, bodies, own, row, near)
        for k in range(p["rays"]):
            row[k] = ONE / (ONE + row[k])
        sensing.write_ego_and_route(r, worlds.routes[b, i], own, row, ego)
        if hasattr(senses.table, "shape"):
            slices = ego, route, near, near + NEIGHBOUR * p["neighbours"]
            prediction.write_predictions(row, slices, senses.table[own["kind"]], legs, path, own)
        end = row.shape[0] - p["needs"]
        if isinstance(features.stopping, bool):
            end -= GOAL
            arrival.observe(r, own, row, end)
        if p["field"] != 0:
            field.observe(r, own, row, end - FIELD)
        worlds.reward[b, i] = write_terms(r, own, senses.weights, worlds.terms[b, i])


@kernel
def observe(begin, end, late, worlds, features, bodies, floor, senses):
    """Write observations, rewards and their terms of the worlds from `begin` to before `end`: those that are `waiting`
    if `late`, which then are no more, else all others. Arguments: see `advance` and worlds.py.
    """
    p = bodies.shared[0]
    places, sights, vehicles = buckets.scratch(worlds.robots.shape[1], p), _sights(p), (p, bodies.kinds)
    for b in range(begin, end):
        if (worlds.waiting[b] != 0) == late:
            worlds.waiting[b] = 0
            _observe_world(worlds, b, places, sights, features, vehicles, floor, senses)
