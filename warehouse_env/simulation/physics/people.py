"""People on foot among the robots: discs that walk from endpoint to endpoint.

A person takes the shortest path to its goal, rests there, keeps its distance from robots and passes them on the right.
If there is no way past, it stands, steps back from robots that come too near, and picks another goal after a few
seconds. Robots make way for people they block (traffic/waits.py). People never walk into robots, so each
contact is the robot's fault. People ignore each other.

Robots see people by lidar. The shield knows where people are, but not where they will go: a robot may drive only if it
can stop before anybody could reach its body (passive motion safety: Bouraine, Fraichard and Salhi 2012). Live routes
avoid standing people; right of way grants nothing across people.
"""

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.kernel import inline, part
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.maps.moves import label_regions
from warehouse_env.simulation.physics.contact import MOVING, put_back, trial_body
from warehouse_env.simulation.physics.footprint import body_touches_shelf, cell_at
from warehouse_env.simulation.physics.geometry import body_at, body_of, square_at, squared_distance_to
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.stops import BODY_COS, BODY_SIN, CENTRE_X, CENTRE_Y
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO
from warehouse_env.simulation.state import PERSON, PERSON_RADIUS

NOTHING, ARRIVED, GIVEN_UP = 0, 1, 2

RADIUS = np.float32(PERSON_RADIUS)  # [m]
PACE = np.float32(1.2)  # [m/s]
KEEP = np.float32(0.4)  # [m] that people keep from robots: closer, the shield would not let a robot drive on
HURRY = np.float32(1.0)  # [s] without progress after which a person counts as standing
AT_GOAL = np.float32(0.2)  # [m] from the goal's centre
PATIENCE = np.float32(3.0)  # [s] without progress until a person gives its goal up
RESTS = (5.0, 15.0)  # [s] at a goal, evenly drawn
_TURNS_AWAY, _TOWARDS = 1.3, 0.5  # [m] to a robot and cosine of its direction: there a person that gave up does not go
START = 2.0  # [m] from the centre of any robot, at the beginning
# Directions tried, as (cosine, sine): straight on, then further and further right or left, then back
_TURNS = np.array([
    (np.cos(eighths * np.pi / 8), np.sin(eighths * np.pi / 8)) for eighths in (0, -1, 1, -2, 2, -4, 4, 8, -7, 7, -6, 6)
], dtype=np.float32)  # fmt: skip
_ONWARD = 7  # of them
_STREAM = 2  # behind the world's own entropy


class People:
    """The people of all worlds.

    persons: PERSON[B, M]; ways: float32[B, M, H, W], cells from each cell to the goal of each, inf if there is no path,
    rows from the south as in the kernels.
    """

    def __init__(self, config: EnvConfig, grid: GridMap, worlds: int) -> None:
        self.persons = np.zeros((worlds, config.people), dtype=PERSON)
        self.ways = np.zeros((worlds, config.people, *grid.shape), dtype=np.float32)
        self._grid, self._reaches = grid, np.array([robot.rear_reach for robot in config.robots], np.float32)
        self._turned_away = np.zeros((worlds, config.people), dtype=np.bool_)  # its goal only moves it out of the way
        # made when first used, as the Dispatcher's
        self._rngs: defaultdict[int, np.random.Generator] = defaultdict(np.random.default_rng)

    def begin(self, world: int, entropy: list[int] | None, robots: NDArray[np.void]) -> None:
        """Place people on the floor, away from robots ROBOT[N]; entropy: seeds their generator, None: it continues.

        Raises ConfigError if there is no room.
        """
        if entropy is not None:
            self._rngs[world] = np.random.default_rng(np.random.SeedSequence([*entropy, _STREAM]))
        self.leave(world)
        for person in range(self.persons.shape[1]):
            goal = self._send(world, person)
            cells = self._rngs[world].permutation(np.argwhere(np.isfinite(self._grid.distance_to(goal))))
            points = self._grid.centre(cells)
            gaps = np.hypot(points[:, :1] - robots["motion"]["x"], points[:, 1:] - robots["motion"]["y"])
            free = np.flatnonzero((gaps >= START).all(axis=1))
            if not len(free):
                many = self.persons.shape[1]
                raise ConfigError(f"people={many} find no place {START:g} m from all robots; ask for fewer of either")
            o = self.persons[world, person]
            o["x"], o["y"] = points[free[0]]
            o["cos"] = ONE

    def leave(self, world: int) -> None:
        """Take all people off the floor, so that the first routes of an episode ignore those of the last one."""
        self.persons[world] = np.zeros((), dtype=PERSON)
        self._turned_away[world] = False

    def send_on(self, robots: NDArray[np.void]) -> None:
        """Give a new goal to each person that wants one.

        One that has arrived rests first. One that has given up turns away from the robots ROBOT[B, N] in its way.
        """
        if not self.persons.size:  # the search below takes longer than a small world's step
            return
        for world, person in np.argwhere(self.persons["wants"] != NOTHING).tolist():
            o = self.persons[world, person]
            turns_away = o["wants"] == GIVEN_UP
            if not turns_away and not self._turned_away[world, person]:
                o["rest"] = self._rngs[world].uniform(*RESTS)
            self._turned_away[world, person], o["wants"] = turns_away, NOTHING
            if turns_away:
                self._turn_away(world, person, robots[world])
            else:
                self._send(world, person)

    def _turn_away(self, world: int, person: int, robots: NDArray[np.void]) -> None:
        """Send a person where it passes no robot: away from near ones if possible, else anywhere."""
        o = self.persons[world, person]
        row, column = self._grid.nearest_cell((o["x"], o["y"])).tolist()
        for away in (True, False):
            floor = self._past_robots(o, robots, away)
            region = label_regions(~floor.occupied)
            cells = [(int(r), int(c)) for r, c in np.argwhere(region == region[row, column])]
            if len(cells) > 1:
                self._send(world, person, cells, floor)
                return
        self._send(world, person)

    def _past_robots(self, o: np.void, robots: NDArray[np.void], away: bool) -> GridMap:
        """Return the floor without the cells of robots and, with `away`, neighbour cells towards near robots."""
        occupied, here = self._grid.occupied.copy(), np.array([o["x"], o["y"]], dtype=np.float64)
        own = self._grid.nearest_cell(here)
        beside = own + MOVES[((own + MOVES >= 0) & (own + MOVES < occupied.shape)).all(axis=-1)]
        ways, motion = self._grid.centre(beside) - here, robots["motion"]
        for share in (0.0, 0.5, 1.0):
            back = share * self._reaches
            points = np.stack([motion["x"] - back * motion["cos"], motion["y"] - back * motion["sin"]], axis=-1)
            occupied[tuple(self._grid.nearest_cell(points).T)] = True
            to = points[np.hypot(*(points - here).T) < (_TURNS_AWAY if away else 0.0)] - here
            along = (ways[:, None] * to).sum(axis=-1)
            ahead = along > _TOWARDS * np.hypot(*ways.T)[:, None] * np.hypot(*to.T)
            occupied[tuple(beside[ahead.any(axis=1)].T)] = True
        occupied[tuple(own)] = False
        one_way = np.where(occupied, 0, self._grid.one_way)
        return GridMap(occupied, cell_size=self._grid.cell_size, one_way=one_way)

    def _send(self, world: int, person: int, cells: list[Cell] | None = None, floor: GridMap | None = None) -> Cell:
        """Draw a person's goal from these cells (default: all endpoints) and return it; floor: the map by default."""
        if cells is None:
            _, _, cells = self._grid.endpoints
        goal = cells[int(self._rngs[world].integers(len(cells)))]
        self.ways[world, person] = (self._grid if floor is None else floor).distance_to(goal)[::-1]
        o = self.persons[world, person]
        o["goal_x"], o["goal_y"] = self._grid.centre(np.array(goal))
        o["left"], o["blocked"] = np.inf, 0.0
        return goal


@inline
def distance_to_body(x, y, cx, cy, c, s, p):
    """Return the distance [m] of a point from the body at (cx, cy) [m], heading (c, s); 0 inside it."""
    return np.sqrt(squared_distance_to(x, y, body_at(cx, cy, c, s, p)))


@inline
def gap_to(x, y, r, p):
    """Return the gap [m] between a person at (x, y) and robot r; negative where they touch."""
    motion = r["motion"]
    body = body_of(motion["x"], motion["y"], motion["cos"], motion["sin"], p)
    return np.sqrt(squared_distance_to(x, y, body)) - RADIUS


@inline
def _may_step(o, x, y, robots, p, kinds, floor):
    """Whether a person may step to (x, y) [m]: clear of shelves, and KEEP from robots or at least not closer."""
    if body_touches_shelf(square_at(x, y, RADIUS), floor):
        return False
    for i in range(robots.shape[0]):
        r, own = robots[i], kind_of(i, p, kinds)
        gap = gap_to(x, y, r, own)
        if gap < KEEP and gap < gap_to(o["x"], o["y"], r, own):
            return False
    return True


@inline
def _left(x, y, way, cell):
    """Return how far [cells] it is to the goal from a point [m]."""
    return way[cell_at(y, cell, way.shape[0]), cell_at(x, cell, way.shape[1])]


@inline
def _leads_on(x, y, way, floor, discs):
    """Whether a path leads on from a point. Cells closed by discs have none, though there may be room."""
    if discs is not None:
        return _left(x, y, way, floor.cell) < np.inf
    return True


@inline
def _is_near(o, robots, gap, p, kinds):
    """Whether a robot is nearer to a person than a gap [m]."""
    near = False
    for i in range(robots.shape[0]):
        near = near or gap_to(o["x"], o["y"], robots[i], kind_of(i, p, kinds)) < gap
    return near


@inline
def _next_place(o, way, p):
    """Return the point [m] to walk to: the centre of the cell beside a person from which the goal is nearest."""
    cell = p["cell"]
    row, column = cell_at(o["y"], cell, way.shape[0]), cell_at(o["x"], cell, way.shape[1])
    best, to_row, to_column = way[row, column], row, column
    for r in range(max(row - 1, 0), min(row + 2, way.shape[0])):
        for c in range(max(column - 1, 0), min(column + 2, way.shape[1])):
            if way[r, c] < best and way[row, c] < np.inf and way[r, column] < np.inf:
                best, to_row, to_column = way[r, c], r, c
    return (np.float32(to_column) + HALF) * cell, (np.float32(to_row) + HALF) * cell


@inline
def _step(o, way, robots, p, kinds, floor):
    """Move a person one step along its path: around obstacles, or back from a near robot."""
    x, y = _next_place(o, way, p)
    dx, dy = x - o["x"], y - o["y"]
    left = np.sqrt(dx * dx + dy * dy)
    if left == ZERO:
        return
    step = min(PACE * p["time_step"], left)
    c, s = dx / left, dy / left
    for k in range(_TURNS.shape[0] if _is_near(o, robots, KEEP, p, kinds) else _ONWARD):
        to_c, to_s = c * _TURNS[k, 0] - s * _TURNS[k, 1], s * _TURNS[k, 0] + c * _TURNS[k, 1]
        to_x, to_y = o["x"] + step * to_c, o["y"] + step * to_s
        free = _may_step(o, to_x, to_y, robots, p, kinds, floor)
        if free and _leads_on(to_x, to_y, way, floor, floor.discs):
            o["x"], o["y"], o["cos"], o["sin"] = to_x, to_y, to_c, to_s
            return


@inline
def _count_kept(o, robots, p, kinds):
    """Count how long robots block a person: it wants to walk, moves less than a metre, and a robot is close."""
    dx, dy = o["x"] - o["anchor_x"], o["y"] - o["anchor_y"]
    if o["rest"] > ZERO or dx * dx + dy * dy > ONE:
        o["anchor_x"], o["anchor_y"], o["kept"] = o["x"], o["y"], ZERO
    elif _is_near(o, robots, KEEP + PACE * p["time_step"], p, kinds):
        o["kept"] += p["time_step"]
        o["longest_kept"] = max(o["longest_kept"], o["kept"])


@part
def walk(persons, ways, robots, walking, p, kinds, floor):
    """Advance the people PERSON[M] of a world by a physics step. ways: float32[M, H, W], see People."""
    if walking is None:
        return
    for m in range(persons.shape[0]):
        o = persons[m]
        _count_kept(o, robots, p, kinds)
        if o["wants"] != NOTHING or o["rest"] > ZERO:
            o["rest"] = max(o["rest"] - p["time_step"], ZERO)
            continue
        dx, dy = o["goal_x"] - o["x"], o["goal_y"] - o["y"]
        if dx * dx + dy * dy < AT_GOAL * AT_GOAL:
            o["wants"] = ARRIVED
            continue
        _step(o, ways[m], robots, p, kinds, floor)
        left = _left(o["x"], o["y"], ways[m], p["cell"])
        if left < o["left"]:
            o["left"], o["blocked"] = left, ZERO
        else:
            o["blocked"] += p["time_step"]
            if o["blocked"] > PATIENCE:
                o["wants"] = GIVEN_UP


@inline
def keep_off_people(robots, persons, motion, flags, p, kinds):
    """Put back the robots whose trial pose touches a person."""
    for m in range(persons.shape[0]):
        o = persons[m]
        for i in range(robots.shape[0]):
            body = trial_body(motion, i, kind_of(i, p, kinds))
            if flags[MOVING, i] != 0 and np.sqrt(squared_distance_to(o["x"], o["y"], body)) <= RADIUS:
                put_back(motion, flags, i)
                r = robots[i]
                events = r["events"]
                events["touching"] = 1
                if events["person_contact"] == 0:
                    events["hit_person"] += 1
                events["person_contact"] = 1


@inline
def end_contacts(robots, persons, walking, p, kinds):
    """End a robot's episode of contact with people once all are farther than near_miss_gap."""
    if walking is None:
        return
    for i in range(robots.shape[0]):
        r = robots[i]
        events = r["events"]
        if events["person_contact"] != 0:
            events["person_contact"] = 0
            for o in persons:
                if gap_to(o["x"], o["y"], r, kind_of(i, p, kinds)) <= p["near_miss_gap"]:
                    events["person_contact"] = 1


@inline
def bars_ways(o):
    """Whether a person stands: it rests at its goal, or has made no progress for a while."""
    return o["rest"] > ZERO or o["blocked"] > HURRY


@inline
def anybody_near(persons, x, y, sweep, p):
    """Whether anybody could come within `sweep` [m] of a point while a robot drives a step and stops."""
    keep = max(p["field_margin"], p["stride"] + PACE * p["dt"])
    reach = sweep + RADIUS + keep + PACE * np.float32(p["stop_samples"]) * p["dt"]
    for o in persons:
        dx, dy = o["x"] - x, o["y"] - y
        if dx * dx + dy * dy <= reach * reach:
            return True
    return False


@inline
def could_meet(persons, path, samples, pace, p):
    """Whether anybody could be where the body will be, at any time of a motion float32[T + 1, PLACE] (see stops.py).

    pace: how far any point of the body moves at most in a substep [m].
    """
    keep = max(p["field_margin"], HALF * (pace + PACE * p["dt"]))  # at samples, so that between them it is not touched
    for o in persons:
        for n in range(1, samples):
            gap = distance_to_body(
                o["x"], o["y"], path[n, CENTRE_X], path[n, CENTRE_Y], path[n, BODY_COS], path[n, BODY_SIN], p
            )
            if gap <= RADIUS + keep + PACE * np.float32(n) * p["dt"]:
                return True
    return False


@inline
def scan_people(persons, pose, walking, rays, out):
    """Shorten the rays float32[2, R] from a pose (x, y [m], cosine, sine) that meet a person."""
    if walking is None:
        return
    cx, cy, c, s = pose
    for o in persons:
        dx, dy = o["x"] - cx, o["y"] - cy
        x, y = dx * c + dy * s, dy * c - dx * s
        beyond = x * x + y * y - RADIUS * RADIUS
        for k in range(rays.shape[1]):
            along = x * rays[0, k] + y * rays[1, k]
            inside = along * along - beyond
            if along > ZERO and inside >= ZERO:
                out[k] = min(out[k], max(along - np.sqrt(inside), ZERO))
