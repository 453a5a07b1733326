"""The batched step: `run` advances worlds (commands, motions, contacts, progress along the routes) and observes them.

With right of way, `assign_right_of_way` (traffic/local_activation.py) runs before it, and `resolve_deadlocks`
(traffic/deadlock_recovery.py) if wait cycles must be resolved. `seek` (traffic/recovery.py) runs after it if robots
seek a manoeuvre. These are separate kernels since few runs need them. Each takes one world after another; the Simulator
hands parts of the batch to threads.

Features that a config does not use are not compiled: see worlds.py.
"""

import numpy as np

from warehouse_env.kernel import inline, kernel
from warehouse_env.simulation.driver import arrival, line, tracking
from warehouse_env.simulation.physics import buckets, contact, contact_episodes, deviation, people, zones
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.kinematics import approach, braking
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO
from warehouse_env.simulation.senses import passages, plans, prediction, sensing
from warehouse_env.simulation.senses.rewards import write_terms
from warehouse_env.simulation.state import GAP_HORIZON, NOBODY
from warehouse_env.simulation.traffic import right_of_way, shield, waits

ADVANCE, OBSERVE, OBSERVE_WAITING = 1, 2, 4
_HORIZON = np.float32(GAP_HORIZON)


@inline
def _begin(r):
    """Clear the events of the last env step."""
    commanded, events = r["commanded"], r["events"]
    r["task"]["acting"] = r["task"]["alive"]
    events["progress"] = ZERO
    events["driven"] = ZERO
    events["gap"] = _HORIZON
    events["arrived"] = 0
    events["touching"] = 0
    r["shield"]["vetoed"] = 0
    r["shield"]["vetoed_by"] = NOBODY
    events["hit_robot"] = 0
    events["hit_shelf"] = 0
    events["hit_person"] = 0
    events["near_miss"] = 0
    commanded["previous_speed"] = commanded["target_speed"]
    commanded["previous_steer"] = commanded["target_steer"]


@inline
def _take_raw(at, r, acceleration, steer_rate, limits, p):
    """Return a robot's raw command [m/s^2], [rad/s] within the limits of its load; a parked robot brakes.

    at: (world, robot); limits: see _command.
    """
    motion = r["motion"]
    if r["task"]["alive"] == 0:
        acceleration, steer_rate = braking(motion["speed"], p), ZERO
    else:
        r["commanded"]["target_speed"] = motion["speed"] + acceleration * p["time_step"]
        r["commanded"]["target_steer"] = motion["steer"] + steer_rate * p["time_step"]
    if limits is not None:
        own, speed = limits[at], motion["speed"]
        most = own["max_acceleration"]
        if speed * acceleration >= ZERO:
            fastest = max((own["max_speed"] - speed) / own["time_step"], ZERO)
            acceleration = min(max(acceleration, -most), min(most, fastest))
    return acceleration, steer_rate


@inline
def _follow(r, route, arcs, first, second, stopping, p, floor):
    """Turn a speed [m/s] and an offset [m] into (acceleration [m/s^2], steering rate [rad/s]) for a physics step."""
    motion = r["motion"]
    if r["task"]["alive"] == 0:
        return braking(motion["speed"], p), ZERO
    dt = p["time_step"]
    if p["right_of_way"] != 0 and r["traffic"]["rules_active"] > ZERO:
        first, second = right_of_way.limit(r, first, p), r["traffic"]["side"]
    tracking.follow(r, route, arcs, first, second, stopping, p, floor)
    next_speed = approach(motion["speed"], r["commanded"]["target_speed"], p["max_acceleration"] * dt)
    next_steer = approach(motion["steer"], r["commanded"]["target_steer"], p["max_steer_rate"] * dt)
    return (next_speed - motion["speed"]) / dt, (next_steer - motion["steer"]) / dt


@inline
def _park(r, p):
    """Take a robot out of service: at once, but under the shield it brakes first, as others expect."""
    r["task"]["alive"] = 0
    if p["field"] == 0:
        r["motion"]["speed"] = ZERO


@inline
def _end(r, route, stopping, p):
    """Advance along the route after a physics step; return 1 on arrival."""
    task, events = r["task"], r["events"]
    if task["alive"] == 0:
        return 0
    events["progress"] += line.locate(r, route)
    waits.count_time(r, p["time_step"])
    r["totals"]["lived"] += 1
    task["age"] += 1
    if events["arrived"] != 0:
        return 0
    if stopping is not None:
        if not arrival.is_there(r, p):
            return 0
    else:
        dx, dy = task["goal_x"] - r["motion"]["x"], task["goal_y"] - r["motion"]["y"]
        if dx * dx + dy * dy > p["arrival_radius"] * p["arrival_radius"]:
            return 0
    events["arrived"] = 1
    if p["one_shot"] != 0:
        _park(r, p)
    return 1


@inline
def _total(r, p):
    """Add the env step's events to the episode's totals; park a robot that a collision ends."""
    events, totals = r["events"], r["totals"]
    totals["hits_robot"] += events["hit_robot"]
    totals["hits_shelf"] += events["hit_shelf"]
    totals["hits_person"] += events["hit_person"]
    totals["near_misses"] += events["near_miss"]
    totals["min_gap"] = min(totals["min_gap"], events["gap"])
    if p["collision_ends"] != 0 and events["hit_robot"] + events["hit_shelf"] + events["hit_person"] > 0:
        _park(r, p)


@inline
def _move(robots, persons, near, motions, walking, guarded, vehicles, floor):
    """Carry out the motions of one physics step, except those into a shelf, a person or another robot."""
    (p, kinds), (pairs, motion, flags, lanes) = vehicles, motions
    for _ in range(p["substeps"]):
        contact.try_motion(motion, flags, lanes, p, kinds)
        contact.keep_off_shelves(robots, motion, flags, guarded, p, kinds, floor)
        if walking is not None:
            people.keep_off_people(robots, persons, motion, flags, p, kinds)
        contact.keep_off_robots(motion, flags, pairs, near, guarded, p, kinds)
        contact.accept_motion(robots, motion)


@inline
def _command(at, worlds, command, limits, followed, stopping, p, floor):
    """Return (acceleration [m/s^2], steering rate [rad/s]) of robot i of world b, at = (b, i), for a physics step.

    command: (speed [m/s], the highest that zones allow, offset [m]), or the raw command in their places; limits
    PARAMETERS[B, N]: of robots under loads, None without loads.
    """
    r, (first, most, second) = worlds.robots[at], command
    if followed is None:
        return _take_raw(at, r, first, second, limits, p)
    own = p
    if limits is not None:
        own = limits[at]
    first = min(max(first, -most), most)
    return _follow(r, worlds.routes[at], worlds.arcs[at], first, second, stopping, own, floor)


@inline
def _choose(worlds, b, commands, setup, scratch):
    """Choose the motion of each robot of world b for one physics step; commands: those in force, float32[N, 2].

    Robots under loads have limits of their own; contact and shield use those without.
    """
    features, (params, kinds), masks, floor = setup.features, setup.planned, setup.equipment.zones, setup.floor
    p, robots, motion = params[0], worlds.robots[b], scratch.motions[1]
    for i in range(robots.shape[0]):
        r, own = robots[i], kind_of(i, p, kinds)
        most = zones.most_speed(r, masks, own)
        command = commands[i, 0], most, commands[i, 1]
        first, second = _command(
            (b, i), worlds, command, worlds.limits, features.followed, features.stopping, own, floor
        )
        first = zones.keep_under(r, first, most, masks, own)
        contact.load(robots, i, first, second, own, floor, motion)
    shield.guard(robots, worlds.persons[b], scratch, features.guarded, features.walking, (p, kinds), floor)


@inline
def _move_bodies(worlds, at, scratch, guarded, walking, erring, vehicles, floor):
    """Carry out the motions chosen in world b, at = (b, physics step of the env step).

    erring: None where bodies follow their plans exactly; vehicles: (p, kinds) of the robots planned, and of the bodies
    (deviation.py).
    """
    (b, repeat), (planned, true), (pairs, motion, flags, lanes) = at, vehicles, scratch.motions
    robots, persons, near = worlds.robots[b], worlds.persons[b], scratch.near[0]
    if erring is None:
        _move(robots, persons, near, scratch.motions, walking, guarded, planned, floor)
        contact.store(robots, motion)
        return
    (p, kinds), (true_p, true_kinds) = planned, true
    actual, errors, own = worlds.actual[b], worlds.errors[b, repeat], scratch.own
    deviation.plan(motion, flags, lanes, p, kinds)
    deviation.load(robots, actual, motion, errors, own, true_p, true_kinds, floor)
    _move(robots, persons, near, (pairs, own, flags, lanes), walking, None, true, floor)
    deviation.store(robots, actual, motion, errors, own, guarded, true_p, true_kinds)


@inline
def _count_step(worlds, b, p):
    """Count the env step of world b, and update its ends."""
    worlds.steps[b] += 1
    worlds.truncated[b] = worlds.steps[b] >= p["max_steps"]
    if p["one_shot"] != 0 or p["collision_ends"] != 0:
        for i in range(worlds.robots.shape[1]):
            worlds.terminated[b, i] = worlds.robots[b, i]["task"]["alive"] == 0


@inline
def _step(worlds, at, setup, scratch):
    """Advance world b by a physics step; at: (b, which one of the env step it is)."""
    (b, repeat), features, floor, (order, starts, bodies) = at, setup.features, setup.floor, scratch.places
    planned, true = (setup.planned.shared[0], setup.planned.kinds), (setup.bodies.shared[0], setup.bodies.kinds)
    (p, kinds), pairs, walking, guarded = planned, scratch.motions[0], features.walking, features.guarded
    robots, persons, clock = worlds.robots[b], worlds.persons[b], worlds.steps[b] * p["repeat"] + 1 + repeat
    buckets.sort(robots, p, kinds, starts, order, bodies)
    scratch.near[0] = contact.list_pairs(bodies, order, starts, p, pairs)
    said = max(p["latency"] - repeat + p["repeat"] - 1, 0) // p["repeat"]  # env steps ago
    _choose(worlds, b, worlds.commands[said, b], setup, scratch)
    _move_bodies(worlds, at, scratch, guarded, walking, features.erring, (planned, true), floor)
    shield.settle(robots, guarded)
    people.walk(persons, worlds.ways[b], robots, walking, p, kinds, floor)
    contact_episodes.judge_pairs(robots, scratch.own, pairs, scratch.near[0], worlds.stamps[b], clock, *true)
    contact_episodes.end_shelf_contacts(robots, *true, floor)
    people.end_contacts(robots, persons, walking, p, kinds)
    for i in range(robots.shape[0]):
        worlds.waiting[b] += _end(robots[i], worlds.routes[b, i], features.stopping, p)


@inline
def _rank(robots, guarded, order):
    """Write the order in which robots commit to motions under the shield."""
    if guarded is not None:
        right_of_way.rank(robots, order)


@inline
def advance(begin, end, worlds, setup, scratch):
    """Move worlds on by one env step; return (arrivals, robots that seek a manoeuvre)."""
    p, guarded = setup.planned.shared[0], setup.features.guarded
    arrivals, seeking, count = 0, 0, worlds.robots.shape[1]
    for b in range(begin, end):
        worlds.waiting[b] = 0
        _rank(worlds.robots[b], guarded, scratch.guards[3])
        for i in range(count):
            _begin(worlds.robots[b, i])
        for repeat in range(p["repeat"]):
            _step(worlds, (b, repeat), setup, scratch)
        for i in range(count):
            _total(worlds.robots[b, i], p)
            seeking += worlds.robots[b, i]["manoeuvre"]["seeks"] != 0
        _count_step(worlds, b, p)
        arrivals += worlds.waiting[b]
    return arrivals, seeking


@inline
def _plan(worlds, b, some, ways, vehicles, floor, sights):
    """Write what some robots plan, and how far their ways are free, if predictions need it."""
    if ways is not None:
        plans.write_plans(worlds, b, some, vehicles, floor, sights)
        passages.write_free_ways(worlds, b, some, vehicles, ways, sights)


@inline
def survey_world(worlds, b, setup, scratch):
    """Sort the robots of world b by place, and count those in passages, for planning and observing."""
    (params, kinds), (order, begins, bodies) = setup.bodies, scratch.places
    buckets.sort(worlds.robots[b], params[0], kinds, begins, order, bodies)
    ways, coming = setup.equipment.passages, scratch.sights.coming
    passages.count_passing(worlds.robots[b], worlds.routes[b], ways, params[0], coming)


@inline
def plan_robots(worlds, b, some, setup, scratch):
    """Write what the robots of world b from some[0] to before some[1] plan."""
    vehicles = setup.bodies.shared, setup.bodies.kinds
    _plan(worlds, b, some, setup.equipment.passages, vehicles, setup.floor, scratch.sights)


@inline
def observe_robot(worlds, b, n, setup, scratch):
    """Write the observation, reward terms and reward of the n-th robot of world b in the order of the buckets."""
    (params, kinds), equipment, (order, _, bodies) = setup.bodies, setup.equipment, scratch.places
    p, rays, starts, i = params[0], equipment.rays, equipment.starts, order[n]
    near, row = starts.neighbours, worlds.observation[b, i]
    r, own = worlds.robots[b, i], kind_of(i, p, kinds)
    pose = bodies[buckets.CENTRE_X, n], bodies[buckets.CENTRE_Y, n], r["motion"]["cos"], r["motion"]["sin"]
    sensing.scan_shelves(pose, own, setup.floor.edges, rays, scratch.sights.turned, row)
    sensing.look_around(n, scratch.places, own, kinds, rays, row, near)
    people.scan_people(worlds.persons[b], pose, setup.features.walking, rays, row)
    sensing.write_neighbours(n, bodies, own, row, near, order, scratch.sights.who)
    for k in range(p["rays"]):
        row[k] = ONE / (ONE + row[k])
    sensing.write_ego_and_route(r, worlds.routes[b, i], own, row, starts.ego, starts.route)
    prediction.write_predictions(worlds, (b, i), row, starts, equipment.table, scratch.sights, own, setup.floor)
    shield.observe(r, own, row, starts.field)
    arrival.observe(r, own, row, starts.goal)
    worlds.reward[b, i] = write_terms(r, own, equipment.weights, worlds.terms[b, i])


@inline
def _observe_world(worlds, b, setup, scratch):
    """Write observations, reward terms and rewards of world b."""
    survey_world(worlds, b, setup, scratch)
    plan_robots(worlds, b, (0, worlds.robots.shape[1]), setup, scratch)
    for n in range(worlds.robots.shape[1]):
        observe_robot(worlds, b, n, setup, scratch)


@kernel
def run(begin, end, what, worlds, setup, scratch):
    """Do `what` with the worlds from `begin` to before `end`; return (arrivals, robots that seek a manoeuvre).

    what: ADVANCE by one env step; then OBSERVE: write observations, rewards and their terms of the worlds that are not
    `waiting`, unless a robot seeks a manoeuvre; or OBSERVE_WAITING: of those that are. worlds, setup, scratch: see
    worlds.py. One kernel does all, since unpacking these takes as long as a step of one robot.
    """
    arrivals, seeking = 0, 0
    if what & ADVANCE:
        arrivals, seeking = advance(begin, end, worlds, setup, scratch)
    if what & (OBSERVE | OBSERVE_WAITING) and seeking == 0:
        for b in range(begin, end):
            if (worlds.waiting[b] != 0) == (what == OBSERVE_WAITING):
                worlds.waiting[b] = 0
                _observe_world(worlds, b, setup, scratch)
    return arrivals, seeking
