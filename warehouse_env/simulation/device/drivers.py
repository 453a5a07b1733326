"""The device's kernels: each runs functions of the CPU's step for the worlds or robots of one thread.

A driver takes (thread, threads, batch). On the CPU it is called for each thread in turn, on a GPU by every
thread of a kernel (memory.py). No function of the step is written twice.
"""

from typing import Any, NamedTuple

from numba.extending import register_jitable

from warehouse_env.simulation import step
from warehouse_env.simulation.driver.scratch import Cells, Nodes, Queue, SearchScratch
from warehouse_env.simulation.physics import deviation
from warehouse_env.simulation.physics.floor import Floor
from warehouse_env.simulation.senses import messages, preferences
from warehouse_env.simulation.senses.on_routes import LANES
from warehouse_env.simulation.senses.plans import Sights
from warehouse_env.simulation.tasks import beginning, giving
from warehouse_env.simulation.tasks.giving import TaskArrays
from warehouse_env.simulation.traffic import deadlock_recovery, local_activation, recovery
from warehouse_env.simulation.traffic.recovery import SearchSetup
from warehouse_env.simulation.worlds import Scratch, Setup, Vehicles, Worlds

TOGETHER = LANES  # robots whose plans a thread writes
NOTHING, ALL, WANTED = range(3)  # what a step does; WANTED: only give routes that robots still want


class Batch(NamedTuple):
    """Everything that the drivers read and write. Arrays of scratch have a leading axis: worlds or threads."""

    worlds: Worlds
    setup: Setup
    scratch: Scratch  # [B, ...]
    sights: Sights  # [T, ...], a set for each thread of `plan` and `observe`
    search: SearchSetup
    searches: SearchScratch  # [T', ...], a set for each thread of `search`
    go: Any  # int64[1]: NOTHING if the actions are invalid, ALL, or WANTED


class Likes(NamedTuple):
    """What `rank` reads and writes (senses/preferences.py)."""

    table: Any  # float32[A, 2]
    sides: Any  # float32[O]
    liked: Any  # float32[B, N, A]
    commands: Any  # float32[S, B, N, 2]
    choices: Any  # float32[B, N, K, 3]
    order: Any  # int64[T, O], scratch


class Noise(NamedTuple):
    """What `draw` and `begin_errors` read and write."""

    keys: Any  # uint64[B, 3], of the Draws
    steps: Any  # int64[B], since the resets
    losses: messages.Losses
    robots: Any  # ROBOT[B, N]
    walk: deviation.Walk
    errors: Any  # float32[B, repeat, N, ERRORS]
    bodies: Any  # BODY[B, N]
    waiting: Any  # int32[B], whether a world has just begun
    go: Any  # see Batch


class Work(NamedTuple):
    """What `give` and `place` read and write."""

    steps: Any  # int64[B], since the resets
    tasks: TaskArrays
    status: Any  # int32[B], see beginning.place
    orders: Any  # (int32[T, E], int32[T, K]), scratch of `place`
    vehicles: Vehicles
    floor: Floor
    go: Any  # see Batch


@register_jitable
def part_of(thread, threads, count):
    """Return a thread's part of `count` worlds: the first, and the one after the last."""
    return thread * count // threads, (thread + 1) * count // threads


@register_jitable
def scratch_of(sets, t):
    """Return set t of scratch."""
    return seen_by(sets, t, sets.sights, t)


@register_jitable
def seen_by(sets, b, seen, t):
    """Return the scratch of world b with what a thread t of its own needs to plan and observe robots."""
    places, motions, guards, sights = sets.places, sets.motions, sets.guards, sets.sights
    return Scratch(
        (places[0][b], places[1][b], places[2][b]),
        (motions[0][b], motions[1][b], motions[2][b], motions[3][b]),
        sets.near[b],
        (guards[0][b], guards[1][b], guards[2][b], guards[3][b]),
        sets.own[b],
        Sights(
            seen.turned[t], sights.plans[b], sights.stops[b], seen.who[t], seen.gaps[t], seen.sides[t],
            seen.asked[t], seen.path[t], seen.probe[t], seen.lanes[t], seen.lane_of[t],
            sights.coming[b], sights.free_ways[b],
        ),
        sets.order[b], sets.found[b],
        (sets.meetings[0][b], sets.meetings[1][b], sets.meetings[2][b], sets.meetings[3][b]),
    )  # fmt: skip


@register_jitable
def search_scratch_of(sets, t):
    """Return set t of the searches' scratch."""
    nodes, cells, queue = sets.nodes, sets.cells, sets.queue
    return SearchScratch(
        Nodes(nodes.poses[t], nodes.parents[t], nodes.by[t]),
        Cells(cells.keys[t], cells.seconds[t]),
        Queue(queue.keys[t], queue.items[t], queue.origins[t], queue.moves[t], queue.ends[t]),
        sets.moves[t], sets.room[t], sets.near[t], sets.far[t], sets.shot[t], sets.bodies[t], sets.rooms[t],
        sets.avoid[t], sets.found[t], sets.poses[t],
    )  # fmt: skip


@register_jitable
def rank(thread, threads, likes):
    """Write commands and choices by preferences."""
    begin, end = part_of(thread, threads, likes.liked.shape[0])
    liked, commands, choices = likes.liked[begin:end], likes.commands[0, begin:end], likes.choices[begin:end]
    preferences.rank(likes.table, likes.sides, liked, commands, choices, likes.order[thread])


@register_jitable
def draw(thread, threads, noise):
    """Draw the errors of the next env step, and which robots are silent in it."""
    begin, end = part_of(thread, threads, noise.steps.shape[0] * noise.go[0])
    messages.draw_silent(begin, end, noise.keys, noise.steps, noise.losses, noise.robots)
    deviation.draw_errors(begin, end, noise.keys, noise.steps, noise.walk, noise.errors)


@register_jitable
def decide(thread, threads, batch):
    """Grant the right of way."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0] * batch.go[0])
    local_activation.assign_right_of_way(begin, end, batch.worlds, batch.setup, scratch_of(batch.scratch, thread))


@register_jitable
def resolve(thread, threads, batch):
    """Search manoeuvres out of wait cycles, and around permanently standing robots."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0] * batch.go[0])
    scratch = search_scratch_of(batch.searches, thread)
    deadlock_recovery.resolve_deadlocks(begin, end, batch.worlds, batch.search, scratch)


@register_jitable
def advance(thread, threads, batch):
    """Move the worlds on by one env step."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0] * batch.go[0])
    step.advance(begin, end, batch.worlds, batch.setup, scratch_of(batch.scratch, thread))


@register_jitable
def search(thread, threads, batch):
    """Search manoeuvres for the robots that seek one."""
    scratch, stopping = search_scratch_of(batch.searches, thread), batch.setup.features.stopping
    worlds, robots = batch.worlds.robots.shape
    for k in range(thread, worlds * robots * batch.go[0], threads):
        recovery.seek_one(k // robots, k % robots, batch.worlds, batch.search, scratch, stopping)


@register_jitable
def give(thread, threads, work):
    """Give the robots that arrived, or are off their routes, goals and routes."""
    begin, end = part_of(thread, threads, work.steps.shape[0] if work.go[0] != NOTHING else 0)
    giving.give(begin, end, work.go[0] == ALL, work.steps, work.tasks)


@register_jitable
def place(thread, threads, work):
    """Place the robots of worlds that begin, with their goals and routes."""
    begin, end = part_of(thread, threads, work.steps.shape[0])
    body, (order, rest) = (work.vehicles.shared[0], work.vehicles.kinds, work.floor), work.orders
    beginning.place(begin, end, work.status, (order[thread], rest[thread]), body, work.tasks, None)


@register_jitable
def begin_errors(thread, threads, noise):
    """Begin the bodies of worlds that begin."""
    begin, end = part_of(thread, threads, noise.steps.shape[0])
    for b in range(begin, end):
        if noise.waiting[b] != 0:
            deviation.begin_errors(b, noise.keys, noise.walk, noise.bodies, noise.robots[b])


@register_jitable
def survey(thread, threads, batch):
    """Sort the robots of worlds that wait to be observed by place, and count those in passages."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0])
    for b in range(begin, end):
        if batch.worlds.waiting[b] != 0:
            step.survey_world(batch.worlds, b, batch.setup, scratch_of(batch.scratch, b))


@register_jitable
def plan(thread, threads, batch):
    """Write what the robots of these worlds plan."""
    worlds, robots = batch.worlds.robots.shape
    groups = (robots + TOGETHER - 1) // TOGETHER
    for k in range(thread, worlds * groups, threads):
        b, begin = k // groups, k % groups * TOGETHER
        if batch.worlds.waiting[b] != 0:
            scratch = seen_by(batch.scratch, b, batch.sights, thread)
            step.plan_robots(batch.worlds, b, (begin, min(begin + TOGETHER, robots)), batch.setup, scratch)


@register_jitable
def observe(thread, threads, batch):
    """Write observations and rewards of the robots of these worlds."""
    worlds, robots = batch.worlds.robots.shape
    for k in range(thread, worlds * robots, threads):
        if batch.worlds.waiting[k // robots] != 0:
            scratch = seen_by(batch.scratch, k // robots, batch.sights, thread)
            step.observe_robot(batch.worlds, k // robots, k % robots, batch.setup, scratch)
