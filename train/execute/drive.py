"""Drive the motions of a plan in the simulator: exactly along their arcs, each once all that go before it have ended.

Robots drive with `raw` actions, within their limits of acceleration and steering rate. They steer while standing, so
that they stay on their arcs, and can always stop at the end of what they may drive.
"""

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.execute.conflicts import NONE
from train.execute.motions import Curves, Motion, Pose
from train.execute.order import Order
from warehouse_env.config import EnvConfig
from warehouse_env.kernel import inline, kernel
from warehouse_env.simulation.driver.driving import ALONG_ARC, BACK_TO_ARC
from warehouse_env.simulation.record.recording import Recorder
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment

_STEERED = 1e-3  # [rad] of steering error up to which a standing robot sets out
_READY = 1e-3  # [m] before a stop that count as there
_STANDS = 1e-5  # [m/s]
_ROUNDED = 2e-5  # [m], more than the rounding of poses
_HALVINGS = 40  # of the interval of speeds


class Tracks(NamedTuple):
    """The arcs of N robots, K at most, one after another."""

    arcs: NDArray[np.float64]  # [N, K, 2]: signed length [m], steering [rad]
    starts: NDArray[np.float64]  # [N, K, 3], poses
    runs: NDArray[np.int64]  # [N, K]: number of arcs up to the end of each one's run of equal ones
    ways: NDArray[np.float64]  # [N, K + 1]: metres before each arc
    counts: NDArray[np.int64]  # [N]


class Limits(NamedTuple):
    """What robots can do in a step."""

    wheelbase: float  # [m]
    forwards: float  # [m/s]
    backwards: float  # [m/s]
    acceleration: float  # [m/s^2]
    steer_rate: float  # [rad/s]
    step: float  # [s]


def tracks_of(own: list[list[Motion]], curves: Curves) -> tuple[Tracks, list[list[int]]]:
    """Return the arcs of all robots, and how many of them lead up to the end of each of their motions."""
    ends = [np.cumsum([len(motion.arcs) for motion in motions], dtype=np.int64).tolist() for motions in own]
    robots, most = len(own), max((end[-1] for end in ends if end), default=0)
    arcs, starts = np.zeros((robots, most, 2)), np.zeros((robots, most, 3))
    for i, motions in enumerate(own):
        k = 0
        for motion in motions:
            pose: Pose = motion.start
            for arc in motion.arcs:
                arcs[i, k], starts[i, k] = arc, pose
                pose, k = curves.end(pose, arc[None]), k + 1
    runs = np.tile(np.arange(1, most + 1), (robots, 1))
    goes_on = (arcs[:, 1:, 0] * arcs[:, :-1, 0] > 0.0) & (arcs[:, 1:, 1] == arcs[:, :-1, 1])
    for k in range(most - 2, -1, -1):
        runs[:, k] = np.where(goes_on[:, k], runs[:, k + 1], runs[:, k])
    ways = np.concatenate([np.zeros((robots, 1)), np.cumsum(np.abs(arcs[..., 0]), axis=1)], axis=1)
    return Tracks(arcs, starts, runs, ways, np.array([end[-1] if end else 0 for end in ends])), ends


@inline
def _stopping_way(speed, slower):
    """Return the way [m] per second of a step until a stop from a speed, which falls by `slower` [m/s] each step."""
    whole = np.floor(speed / slower)
    rest = speed - whole * slower
    return whole * (speed + rest) / 2 + rest / 2


@inline
def _next_speed(speed, fastest, way, limits):
    """Return the highest speed [m/s] after this step from which the robot can still stop within `way` [m]."""
    change = limits.acceleration * limits.step
    low, high = max(speed - change, 0.0), max(min(speed + change, fastest), 0.0)
    for k in range(_HALVINGS + 1):
        middle = high if k == 0 else (low + high) / 2
        if ((speed + middle) / 2 + _stopping_way(middle, change)) * limits.step <= way:
            low = middle
        else:
            high = middle
    return low


@inline
def _beside(pose, start, length, bend):
    """Return (metres along an arc, metres to the left of it, radians off it) of a pose."""
    dx, dy, c, s = pose[0] - start[0], pose[1] - start[1], np.cos(start[2]), np.sin(start[2])
    ahead, left = dx * c + dy * s, dy * c - dx * s
    turn = 0.0
    if bend != 0.0:
        turn = np.arctan2(bend * ahead, 1.0 - bend * left)
        radius = np.sqrt((bend * ahead) ** 2 + (1.0 - bend * left) ** 2)
        ahead, left = turn / bend, (1.0 - radius) / bend
    off = pose[2] - start[2] - turn
    off -= 2.0 * np.pi * np.rint(off / (2.0 * np.pi))
    return (ahead if length > 0.0 else -ahead), left, off


@kernel
def _command(i, motion, allowed, arc, tracks, limits, action):
    """Write the action of robot i, and go on to its next arc where it is at the end of one; return metres off its arc.

    motion: of its record; allowed: number of arcs that it may drive, -1 while it is held up.
    """
    pose = np.float64(motion["x"]), np.float64(motion["y"]), np.float64(motion["heading"])
    speed, steer = np.float64(motion["speed"]), np.float64(motion["steer"])
    standing = abs(speed) < _STANDS
    while True:
        k = arc[i]
        if k == tracks.counts[i]:
            return 0.0
        length, wanted = tracks.arcs[i, k]
        bend = -np.tan(wanted) / limits.wheelbase
        along, left, off = _beside(pose, tracks.starts[i, k], length, bend)
        to_go, last = abs(length) - along, tracks.runs[i, k] == k + 1 or allowed <= k + 1
        if allowed <= k or not (to_go <= _READY and standing if last else to_go <= 0.0):
            break
        arc[i] += 1
    end = min(tracks.runs[i, k], allowed)
    way = tracks.ways[i, end] - tracks.ways[i, k] - along if allowed > k else 0.0
    forwards = length > 0.0
    bend -= BACK_TO_ARC * left + (ALONG_ARC if forwards else -ALONG_ARC) * off
    steering = np.arctan(-bend * limits.wheelbase) - steer
    if way < _ROUNDED or (standing and abs(steering) > _STEERED):
        way = 0.0
    target = _next_speed(abs(speed), limits.forwards if forwards else limits.backwards, way, limits)
    action[0] = ((target if forwards else -target) - speed) / (limits.acceleration * limits.step)
    action[1] = steering / (limits.steer_rate * limits.step)
    return abs(left)


@kernel
def _commands(motion, allowed, arc, tracks, limits, actions):
    """Write the actions float64[N, 2] of all robots; return the most metres that one is off its arc."""
    worst = 0.0
    for i in range(len(arc)):
        worst = max(worst, _command(i, motion[i], allowed[i], arc, tracks, limits, actions[i]))
    return worst


class Drive:
    """N robots on their way along the motions of a plan."""

    def __init__(self, order: Order, curves: Curves, config: EnvConfig) -> None:
        """config: of the floor and the robots, with raw actions."""
        self.order, robots, many = order, len(order.own), len(order.motions.robot)
        self._tracks, ends = tracks_of(order.own, curves)
        self._ends = [[0, *own] for own in ends]
        robot, step = config.robot, config.time_step * config.action_repeat
        self._limits = Limits(
            robot.wheelbase, robot.max_speed, -robot.min_speed, robot.max_acceleration, robot.max_steering_rate, step
        )
        self.simulator = Simulator(config, 1, grid=curves.grid)
        goals = [
            curves.end(own[-1].start, own[-1].arcs)[:2] if own else start[:2]
            for own, start in zip(order.own, order.starts, strict=True)
        ]
        self.recorder = Recorder(self.simulator, (0,), start=Assignment(np.array(order.starts), np.array(goals)))
        self._follows, self._leads = _grouped(order.edges[:, ::-1], many), _grouped(order.edges, many)
        self._missing = np.array([len(before) for before in self._follows])
        self._arc, self._may = np.zeros(robots, np.int64), np.zeros(robots, np.int64)  # arcs driven, and allowed
        self._allowed = [0] * robots  # motions
        self.done = [0] * robots  # motions that each has ended,
        self.ended: list[list[float]] = [[] for _ in range(robots)]  # [s], and when
        self.waited: Counter[tuple[int, int]] = Counter()  # steps for which the first motion waited for the second
        self.off = 0.0  # [m], most that a robot was beside its arc
        for i in range(robots):
            self._allow(i)

    @property
    def over(self) -> bool:
        """Whether all robots have driven their whole plans."""
        return bool((self._arc == self._tracks.counts).all())

    def step(self, held: NDArray[np.bool_]) -> None:
        """Drive for one step of the simulator. held bool[N]: robots that a delay stops."""
        motion, actions = self.simulator.robots["motion"][0], np.zeros((len(held), 2))
        allowed = np.where(held, NONE, self._may)
        off = _commands(motion, allowed, self._arc, self._tracks, self._limits, actions)
        self.off, seconds = max(self.off, off), self.simulator.seconds(0)
        for i in range(len(held)):
            self._end_motions(i, seconds)
        for i in np.flatnonzero((self._may == self._arc) & (self._arc < self._tracks.counts) & ~held).tolist():
            self._count_wait(i)
        self.recorder.step(np.clip(actions, -1.0, 1.0).astype(np.float32)[None])

    def _end_motions(self, i: int, seconds: float) -> None:
        """Note the motions that a robot has ended, and allow those that waited for them."""
        while self.done[i] < len(self._ends[i]) - 1 and self._ends[i][self.done[i] + 1] <= self._arc[i]:
            after = self._leads[self.order.of[i][self.done[i]]]
            self.done[i] += 1
            self.ended[i].append(seconds)
            self._missing[after] -= 1
            for robot in set(self.order.motions.robot[after].tolist()):
                self._allow(robot)

    def _allow(self, i: int) -> None:
        """Let a robot drive all its next motions that need not wait."""
        own, k = self.order.of[i], self._allowed[i]
        while k < len(own) and self._missing[own[k]] == 0:
            k += 1
        self._allowed[i], self._may[i] = k, self._ends[i][k]

    def _count_wait(self, i: int) -> None:
        """Note for which motion a robot waits."""
        own, robot = self.order.of[i][self.done[i]], self.order.motions.robot
        for other in self._follows[own].tolist():
            of = self.order.of[robot[other]]
            if self.done[robot[other]] < len(of) and of[self.done[robot[other]]] <= other:  # it has not ended
                self.waited[own, other] += 1
                return


def _grouped(pairs: NDArray[np.int64], many: int) -> list[NDArray[np.int64]]:
    """Return for each number up to `many` the second numbers of the pairs that it is first in."""
    order = np.argsort(pairs[:, 0], kind="stable")
    counts = np.bincount(pairs[:, 0], minlength=many)
    return np.split(pairs[order, 1], np.cumsum(counts)[:-1])
