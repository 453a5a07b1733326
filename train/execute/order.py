"""Who drives where first: the action dependency graph of a plan's motions (Hoenig et al. 2019).

Two motions conflict if the areas that the bodies sweep, each grown by half of MARGIN, share a point. One begins after
the end of the other: on the whole in the order of the plan. A motion cannot pass where another robot rests in its way,
so it passes before or after all such rests. Motions that may be under way at the same time never touch, whatever the
delays. Motions that wait for each other in a cycle can never begin. Then an obstacle is passed on its other side, or
one of the motions is made by another curve, and the order found anew.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from train.execute.conflicts import NONE, Areas, Motions, collect, conflicts, sweeps_any, swept_rests
from train.execute.motions import Choice, Curves, Motion, Pose, motions_of
from train.execute.plan import GridPlan, path_of
from warehouse_env.errors import PlanError, counted
from warehouse_env.maps.grid_map import Cell

ROUNDS = 20  # of other curves
PATIENCE, TRIES = 300, 3  # trials of other sides without a gain: among motions in cycles, and among all
_TIE = 1e-3  # steps: of motions that begin together, the first goes first


class Order(NamedTuple):
    """The motions of a plan and their order."""

    own: list[list[Motion]]  # of each robot
    starts: list[Pose]  # of each robot
    of: list[list[int]]  # their numbers among all
    motions: Motions
    edges: NDArray[np.int64]  # [E, 2]: the second begins after the end of the first
    cycles: list[list[int]]  # motions that wait for each other, or one that would sweep over a robot that never moves

    @property
    def stuck(self) -> int:
        """Number of motions in cycles."""
        return sum(map(len, self.cycles))


def find_order(plan: GridPlan, curves: Curves, tick: Callable[[int], None] = lambda left: None) -> Order:
    """Return the order of a plan's motions; without cycles if other curves can avoid them.

    tick: called with the number of cycles after each round. PlanError if a body cannot follow the plan by itself.
    """
    areas, rng = Areas(curves), np.random.default_rng(0)
    paths = [path_of(plan.cells[:, i]) for i in range(plan.cells.shape[1])]
    avoided: list[set[Choice]] = [set() for _ in paths]
    own: list[list[Motion]] = []
    best: Order | None = None
    for i, (cells, _) in enumerate(paths):
        try:
            own.append(motions_of(cells, curves))
        except PlanError as error:
            raise PlanError(f"robot {i}: {error}") from None
    for _ in range(ROUNDS):
        found = _order(list(own), paths, areas, rng)
        tick(len(found.cycles))
        if best is None or found.stuck < best.stuck:
            best = found
        motions = {p: (i, own[i][k]) for i, numbers in enumerate(found.of) for k, p in enumerate(numbers)}
        turning = [[p for p in cycle if motions[p][1].arcs[:, 1].any()] for cycle in found.cycles]
        chosen = [motions[int(rng.choice(cycle))] for cycle in turning if cycle]
        if not chosen:
            break
        for i, motion in chosen:
            avoided[i].add(motion.choice)
        for i in {i for i, _ in chosen}:
            own[i] = motions_of(paths[i][0], curves, avoided[i])
    assert best is not None
    return best


def _order(
    own: list[list[Motion]], paths: Sequence[tuple[list[Cell], list[int]]], areas: Areas, rng: np.random.Generator
) -> Order:
    """Return the order of the robots' motions along their paths (path_of)."""
    ranked = sorted(
        (paths[i][1][motion.leaves + 1] - 1, i, k) for i, motions in enumerate(own) for k, motion in enumerate(motions)
    )
    starts = [m[0].start if m else areas.curves.pose(cells[0], 0) for m, (cells, _) in zip(own, paths, strict=True)]
    place = {(i, k): p for p, (_, i, k) in enumerate(ranked)}
    of = [[place[i, k] for k in range(len(motions))] for i, motions in enumerate(own)]
    motions = collect([areas.of(own[i][k]) for _, i, k in ranked], ranked, of)
    standing = np.array([areas.body(pose) for pose, m in zip(starts, own, strict=True) if not m]).reshape(-1, 6)
    over = np.array([p for p in range(len(ranked)) if sweeps_any(p, standing, motions)], np.int64)
    pairs = conflicts(motions)
    cycles = dict[int, list[int]]()
    edges = np.column_stack([over, over])  # these never begin
    if len(pairs):
        obstacles = _obstacles(pairs, motions)
        label = _pass_otherwise(obstacles, motions, rng)
        for p in np.flatnonzero(label != NONE).tolist():
            cycles.setdefault(int(label[p]), []).append(p)
        edges = np.concatenate([_without_implied(_directed(obstacles, obstacles.pairs), motions), edges])
    return Order(own, starts, of, motions, edges, [*cycles.values(), *([p] for p in over.tolist())])


class _Obstacles(NamedTuple):
    """Conflicts in groups: each is an obstacle in the space of two robots' progress, which is passed on one side.

    A motion cannot pass while another robot rests in its way, so its conflicts with the motions before and after such a
    rest are one group.
    """

    pairs: NDArray[np.int64]  # [C, 2]
    group: NDArray[np.int64]  # [C]
    side: NDArray[np.int64]  # [C]: 1 if the robot of the first motion has the lower number, else -1
    ahead: NDArray[np.int64]  # [G]: 1 if the lower robot goes first, -1 if the other does
    fixed: NDArray[np.bool_]  # [G]: there is no choice: a robot starts, or will stay, where the other drives
    stuck: NDArray[np.bool_]  # [C]: not even one


def _obstacles(pairs: NDArray[np.int64], motions: Motions) -> _Obstacles:
    """Return the obstacles; the robot goes first that the plan has there first on the whole, or that must."""
    many, known = len(motions.robot), 0
    while known < len(pairs):  # what a robot does before and after a rest that is swept counts, however long it rests
        known, swept = len(pairs), swept_rests(pairs, motions)
        rests = list(_rests_swept(pairs, swept, motions))
        beyond = [np.sort(np.column_stack([mover, other]), axis=1) for _, mover, other, _ in rests]
        pairs = np.unique(np.concatenate([pairs, *(both[both[:, 0] != NONE] for both in beyond)]), axis=0)
    first, second = pairs.T
    keys, links, forced = first * many + second, list[NDArray[np.int64]](), np.zeros((2, len(pairs)), np.bool_)
    for (at, _, other, leads), both in zip(rests, beyond, strict=True):
        forced[leads, at[other == NONE]] = True  # 0: the first motion must go first, 1: the second
        kept = other != NONE
        links.append(np.column_stack([at[kept], np.searchsorted(keys, both[kept] @ (many, 1))]))
    joined = np.concatenate(links)
    graph = csr_array((np.ones(len(joined), np.int8), joined.T), shape=(len(pairs), len(pairs)))
    count, group = connected_components(graph, directed=False)
    side = np.where(motions.robot[first] < motions.robot[second], 1, -1)
    ahead = np.bincount(group, side * (motions.leaves[second] - motions.leaves[first] + _TIE), count)
    must = np.bincount(group, side * (forced[0].astype(np.int64) - forced[1]), count)
    ahead = np.where(must != 0.0, must, ahead)
    fixed = np.bincount(group, forced.any(axis=0), count) > 0
    wrong = np.where(ahead[group] * side > 0, forced[1], forced[0])
    return _Obstacles(pairs, group, side, np.where(ahead > 0, 1, -1), fixed, wrong)


def _rests_swept(
    pairs: NDArray[np.int64], swept: NDArray[np.bool_], motions: Motions
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], int]]:
    """Yield, for each end of each motion of the pairs, which of these ends are swept and by what.

    That is: numbers of pairs; the motions that sweep; the motions beyond the rests, NONE if there is none; and which
    motion of a pair must then go first: 0 the first, 1 the second.
    """
    for mover, rest in ((0, 1), (1, 0)):
        for end, neighbours in enumerate((motions.previous, motions.following)):
            at = np.flatnonzero(swept[:, 2 * mover + end])
            yield at, pairs[at, mover], neighbours[pairs[at, rest]], mover if end else rest


def _directed(obstacles: _Obstacles, pairs: NDArray[np.int64], at: Any = slice(None)) -> NDArray[np.int64]:
    """Return pairs int64[K, 2], all or those numbered `at`, the motion first that goes first; both ways if none can."""
    group, side, stuck = obstacles.group[at], obstacles.side[at], obstacles.stuck[at]
    lower = obstacles.ahead[group] * side > 0
    return np.concatenate([np.where(lower[:, None], pairs, pairs[:, ::-1]), pairs[stuck], pairs[stuck][:, ::-1]])


def _without_implied(edges: NDArray[np.int64], motions: Motions) -> NDArray[np.int64]:
    """Return the edges without those that follow from others: a robot's motion ends after all of its earlier ones."""
    order = np.lexsort((edges[:, 0], motions.robot[edges[:, 0]], edges[:, 1]))
    edges = np.asarray(edges[order])
    same = (edges[1:, 1] == edges[:-1, 1]) & (motions.robot[edges[1:, 0]] == motions.robot[edges[:-1, 0]])
    kept: NDArray[np.int64] = edges[np.append(~same, True)[: len(edges)]]
    return kept


def _cycles(edges: NDArray[np.int64], following: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return int64[P]: which cycle of edges and following motions each is in, NONE for most."""
    goes_on = np.flatnonzero(following != NONE)
    edges, many = np.concatenate([edges, np.column_stack([goes_on, following[goes_on]])]), len(following)
    graph = csr_array((np.ones(len(edges), np.int8), edges.T), shape=(many, many))
    _, label = connected_components(graph, connection="strong")
    found: NDArray[np.int64] = np.where(np.bincount(label, minlength=1)[label] > 1, label, NONE)
    return found


def _pass_otherwise(obstacles: _Obstacles, motions: Motions, rng: np.random.Generator) -> NDArray[np.int64]:
    """Pass obstacles on the other side while fewer motions are then in cycles; return which each is in, or NONE."""
    label, tries = _cycles(_directed(obstacles, obstacles.pairs), motions.following), TRIES
    while (label != NONE).any() and tries > 0:
        before = obstacles.ahead.copy()
        _untangle(obstacles, motions, label, rng)
        found = _cycles(_directed(obstacles, obstacles.pairs), motions.following)
        if (found != NONE).sum() < (label != NONE).sum():
            label = found
        else:
            obstacles.ahead[:], tries = before, tries - 1
    return label


def _untangle(obstacles: _Obstacles, motions: Motions, label: NDArray[np.int64], rng: np.random.Generator) -> None:
    """Search sides that leave fewer motions in cycles, among these motions alone.

    Reversing an edge of a cycle makes no cycle with motions outside it. But an obstacle may have edges elsewhere.
    """
    inside, number = np.flatnonzero(label != NONE), np.full(len(label) + 1, NONE)  # the last one stands for NONE
    number[inside] = np.arange(len(inside))
    at = np.flatnonzero((label[obstacles.pairs] != NONE).all(axis=1))
    pairs, following = number[obstacles.pairs[at]], number[motions.following[inside]]
    found, patience = _cycles(_directed(obstacles, pairs, at), following), PATIENCE
    while (found != NONE).any() and patience > 0:
        own, other = found[pairs].T
        candidates = rng.permutation(
            np.flatnonzero((own == other) & (own != NONE) & ~obstacles.fixed[obstacles.group[at]])
        )
        _, one_each = np.unique(own[candidates], return_index=True)
        turned = obstacles.group[at[candidates[one_each]]]
        if not len(turned):
            return
        obstacles.ahead[turned] *= -1
        tried = _cycles(_directed(obstacles, pairs, at), following)
        fewer = (found != NONE).sum() - (tried != NONE).sum()
        patience = PATIENCE if fewer > 0 else patience - 1
        if fewer >= 0:
            found = tried
        else:
            obstacles.ahead[turned] *= -1


def why_stuck(order: Order, plan: GridPlan) -> list[str]:
    """Return a sentence for each cycle."""
    found = []
    for cycle in order.cycles:
        steps, robots = order.motions.leaves[cycle], sorted(set(order.motions.robot[cycle].tolist()))
        row, column = plan.cells[steps[0], order.motions.robot[cycle[0]]].tolist()
        if len(cycle) == 1:
            found.append(f"step {steps[0]}: robot {robots[0]} leaves ({row}, {column}) over a robot that never moves")
            continue
        who = f"{', '.join(map(str, robots[:-1]))} and {robots[-1]}"
        found.append(
            f"steps {steps.min()} to {steps.max() + 1}, near cell ({row}, {column}): robots {who} block each other, "
            f"since each would have to move first ({counted(len(cycle), 'motion')})"
        )
    return found
