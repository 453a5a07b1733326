"""The device's kernels: each runs functions of the CPU's step for the worlds of one thread.

A driver takes (thread, threads, batch). On the CPU it is called for each thread in turn, on a GPU by every
thread of a kernel (memory.py). No function of the step is written twice.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from warehouse_env.simulation import step
from warehouse_env.simulation.driver.scratch import Cells, Nodes, Queue, SearchScratch
from warehouse_env.simulation.physics import deviation
from warehouse_env.simulation.senses import messages, preferences
from warehouse_env.simulation.traffic import deadlock_recovery, decision, off_route, recovery
from warehouse_env.simulation.traffic.recovery import SearchSetup
from warehouse_env.simulation.worlds import Scratch, Setup, Worlds


class Batch(NamedTuple):
    """Everything that the drivers read and write. Arrays of scratch have a leading axis: the threads."""

    worlds: Worlds
    setup: Setup
    scratch: Scratch  # [T, ...], a set for each thread of `advance` and `observe`
    search: SearchSetup
    searches: SearchScratch  # [T', ...], a set for each thread of `search`
    far: np.float32  # [m] from which a robot is off its route (traffic/off_route.py)
    calls: Any  # bool[B, N], the robots that need a route from the host


class Likes(NamedTuple):
    """What `rank` reads and writes (senses/preferences.py)."""

    table: Any  # float32[A, 2]
    sides: Any  # float32[O]
    liked: Any  # float32[B, N, A]
    commands: Any  # float32[S, B, N, 2]
    choices: Any  # float32[B, N, K, 3]
    order: Any  # int64[T, O], scratch


class Noise(NamedTuple):
    """What `lose` and `err` read and write."""

    keys: Any  # uint64[B, 3], of the Draws
    steps: Any  # int64[B], since the resets
    losses: messages.Losses
    robots: Any  # ROBOT[B, N]
    walk: deviation.Walk
    errors: Any  # float32[B, repeat, N, ERRORS]


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
        sets.own[t], (sights[0][t], sights[1][t], sights[2][t]), sets.order[t], sets.found[t],
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
def lose(thread, threads, noise):
    """Draw which robots are silent in the next env step."""
    begin, end = part_of(thread, threads, noise.steps.shape[0])
    messages.draw_silent(begin, end, noise.keys, noise.steps, noise.losses, noise.robots)


@register_jitable
def err(thread, threads, noise):
    """Draw the errors of the next env step."""
    begin, end = part_of(thread, threads, noise.steps.shape[0])
    deviation.draw_errors(begin, end, noise.keys, noise.steps, noise.walk, noise.errors)


@register_jitable
def decide(thread, threads, batch):
    """Grant the right of way."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0])
    decision.assign_right_of_way(begin, end, batch.worlds, batch.setup, scratch_of(batch.scratch, thread))


@register_jitable
def resolve(thread, threads, batch):
    """Search manoeuvres out of wait cycles, and around robots that stand for good."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0])
    scratch = search_scratch_of(batch.searches, thread)
    deadlock_recovery.resolve_deadlocks(begin, end, batch.worlds, batch.search, scratch)


@register_jitable
def advance(thread, threads, batch):
    """Move the worlds on by one env step."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0])
    step.run(begin, end, step.ADVANCE, batch.worlds, batch.setup, scratch_of(batch.scratch, thread))


@register_jitable
def search(thread, threads, batch):
    """Search manoeuvres for the robots that seek one, and list the robots that need a route from the host."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0])
    stopping, worlds, calls = batch.setup.features.stopping, batch.worlds, batch.calls
    recovery.seek(begin, end, worlds, batch.search, search_scratch_of(batch.searches, thread), stopping)
    off_route.find_off_route(worlds.robots[begin:end], worlds.routes[begin:end], batch.far, calls[begin:end])
    for b in range(begin, end):
        for i in range(calls.shape[1]):
            calls[b, i] = calls[b, i] or worlds.robots[b, i]["events"]["arrived"] != 0


@register_jitable
def observe(thread, threads, batch):
    """Write observations and rewards of all worlds."""
    begin, end = part_of(thread, threads, batch.worlds.steps.shape[0])
    scratch = scratch_of(batch.scratch, thread)
    step.run(begin, end, step.OBSERVE, batch.worlds, batch.setup, scratch)
    step.run(begin, end, step.OBSERVE_WAITING, batch.worlds, batch.setup, scratch)
