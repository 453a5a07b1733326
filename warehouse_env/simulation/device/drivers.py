"""The device's kernels: each runs functions of the CPU's step for the worlds of one thread.

A driver takes (thread, threads, batch). On the CPU it is called for each thread in turn, on a GPU by every
thread of a kernel (memory.py). No function of the step is written twice.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba.extending import register_jitable

from warehouse_env.simulation import step
from warehouse_env.simulation.driver.scratch import Cells, Nodes, Queue, SearchScratch
from warehouse_env.simulation.physics import deviation
from warehouse_env.simulation.physics.floor import Floor
from warehouse_env.simulation.senses import messages, preferences
from warehouse_env.simulation.senses.plans import Sights
from warehouse_env.simulation.tasks import giving
from warehouse_env.simulation.tasks.giving import TaskArrays
from warehouse_env.simulation.traffic import deadlock_recovery, decision, recovery
from warehouse_env.simulation.traffic.recovery import SearchSetup
from warehouse_env.simulation.worlds import Scratch, Setup, Vehicles, Worlds

NOTHING, ALL, WANTED = range(3)  # what a step does; WANTED: only give routes that robots still want


class Batch(NamedTuple):
    """Everything that the drivers read and write. Arrays of scratch have a leading axis: the threads."""

    worlds: Worlds
    setup: Setup
    scratch: Scratch  # [T, ...], a set for each thread of `advance` and `observe`
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
    status: Any  # int32[B], see giving.place
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
    places, motions, guards, sights = sets.places, sets.motions, sets.guards, sets.sights
    return Scratch(
        (places[0][t], places[1][t], places[2][t]),
        (motions[0][t], motions[1][t], motions[2][t], motions[3][t]),
        sets.near[t],
        (guards[0][t], guards[1][t], guards[2][t], guards[3][t]),
        sets.own[t],
        Sights(
            sights.turned[t], sights.plans[t], sights.who[t], sights.gaps[t], sights.sides[t], sights.asked[t],
            sights.path[t], sights.probe[t], sights.lanes[t], sights.lane_of[t],
            sights.coming[t], sights.free_ways[t],
        ),
        sets.order[t], sets.found[t],
        (sets.meetings[0][t], sets.meetings[1][t], sets.meetings[2][t], sets.meetings[3][t]),
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
    decision.assign_right_of_way(begin, end, batch.worlds, batch.setup, scratch_of(batch.scratch, thread))


@register_jitable
def resolve(thread, threads, batch):
    """Search manoeuvres out of wait cycles, and around robots that stand for good."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0] * batch.go[0])
    scratch = search_scratch_of(batch.searches, thread)
    deadlock_recovery.resolve_deadlocks(begin, end, batch.worlds, batch.search, scratch)


@register_jitable
def advance(thread, threads, batch):
    """Move the worlds on by one env step."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0] * batch.go[0])
    step.run(begin, end, step.ADVANCE, batch.worlds, batch.setup, scratch_of(batch.scratch, thread))


@register_jitable
def search(thread, threads, batch):
    """Search manoeuvres for the robots that seek one."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0] * batch.go[0])
    scratch, stopping = search_scratch_of(batch.searches, thread), batch.setup.features.stopping
    recovery.seek(begin, end, batch.worlds, batch.search, scratch, stopping)


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
    giving.place(begin, end, work.status, (order[thread], rest[thread]), body, work.tasks)


@register_jitable
def begin_errors(thread, threads, noise):
    """Begin the bodies of worlds that begin."""
    begin, end = part_of(thread, threads, noise.steps.shape[0])
    for b in range(begin, end):
        if noise.waiting[b] != 0:
            deviation.begin_errors(b, noise.keys, noise.walk, noise.bodies, noise.robots[b])


@register_jitable
def observe(thread, threads, batch):
    """Write observations and rewards of the worlds that wait for it."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0])
    step.run(begin, end, step.OBSERVE_WAITING, batch.worlds, batch.setup, scratch_of(batch.scratch, thread))
