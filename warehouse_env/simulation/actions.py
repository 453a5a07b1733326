"""Actions of policies -> commands of robots: (speed [m/s], lateral offset [m]), or (acceleration, steering rate)."""

from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import ActionError
from warehouse_env.kernel import kernel
from warehouse_env.simulation.senses import preferences


@kernel
def _look_up(table, actions, commands):
    """Write commands float32[B, N, 2] from actions int[B, N] by table float32[K, 2]; False if one is not in 0..K-1."""
    for b in range(actions.shape[0]):
        for i in range(actions.shape[1]):
            k = actions[b, i]
            if k < 0 or k >= table.shape[0]:
                return False
            commands[b, i, 0] = table[k, 0]
            commands[b, i, 1] = table[k, 1]
    return True


class CommandLimits(NamedTuple):
    """Limits of the robots: numbers if all are alike, else float64[N]."""

    slowest: Any  # [m/s]
    fastest: Any  # [m/s]
    hardest: Any  # [m/s^2]
    quickest: Any  # [rad/s] of steering
    cruise: Any  # [m/s], the fastest level


class ActionDecoder:
    """Decode actions of a config.

    discrete: the index of a (speed level, lateral offset) pair, offsets running fastest; or a preference for each pair:
        the robot drives the preferred one, unless right of way takes another.
    continuous: two numbers in [-1, 1] around cruising on the route: the speed from min_speed over the fastest level
        (at 0) to max_speed, and the offset in units of the largest one.
    raw: acceleration and steering rate in units of their limits.

    In a fleet of several kinds, each robot has its own limits, which also cap the speed levels.
    """

    def __init__(self, config: EnvConfig) -> None:
        self._config = config
        self.space: gymnasium.Space[Any]
        levels, offsets = config.speed_levels, config.lateral_offsets
        self._widest = max(abs(o) for o in offsets)
        self._fleet = bool(config.fleet)
        names = ("min_speed", "max_speed", "max_acceleration", "max_steering_rate")
        slowest, fastest, hardest, quickest = map(self._of_each, names)
        cruise = np.minimum(max(levels), fastest) if self._fleet else max(levels)
        self.limits = CommandLimits(slowest, fastest, hardest, quickest, cruise)
        self.table = np.array([(v, o) for v in levels for o in offsets], dtype=np.float32)
        self.sides = np.array(sorted(set(offsets), key=lambda o: (abs(o), o)), dtype=np.float32)  # the right one first
        if config.action_type == "discrete":
            self.space = gymnasium.spaces.Discrete(len(self.table))
        else:
            self.space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def _of_each(self, limit: str) -> Any:
        """Return a limit of the robots: a number if all are alike, else float64[N]."""
        robots = self._config.robots if self._fleet else (self._config.robot,)
        each = np.array([getattr(robot, limit) for robot in robots])
        return each if self._fleet else float(each[0])

    def commands_of(self, robot: RobotSpec) -> NDArray[np.float32]:
        """Return `table` with the speeds capped at a robot's limits."""
        table = self.table.copy()
        table[:, 0] = np.clip(table[:, 0], robot.min_speed, robot.max_speed)
        return table

    @property
    def cruise(self) -> NDArray[Any]:
        """One robot's action that drives along the route at full speed (raw: no command at all)."""
        if self._config.action_type == "discrete":
            distance = np.where(self.table[:, 0] == self.table[:, 0].max(), np.abs(self.table[:, 1]), np.inf)
            return np.asarray(int(distance.argmin()), dtype=np.int64)
        return np.zeros(2, dtype=np.float32)

    def no_choices(self, worlds: int, robots: int) -> NDArray[np.float32]:
        """Return empty choices float32[B, N, K, 3] (preferences.py); K = 0 without right of way."""
        return np.zeros(
            (worlds, robots, 1 + len(self.sides) if self._config.traffic_spec.right_of_way else 0, 3), np.float32
        )

    def decode(self, actions: ArrayLike, commands: NDArray[np.float32], choices: NDArray[np.float32]) -> None:
        """Write commands float32[B, N, 2] of all robots, and their choices if there are any.

        Raises ActionError for a wrong shape, type or range.
        """
        kind = self._config.action_type
        try:
            given = np.asarray(actions)
        except ValueError:
            raise ActionError(f"{kind} actions must be numbers in an array, not lists of different lengths") from None
        if kind == "discrete" and given.ndim == 3 and given.dtype.kind in "fu":
            self._rank(given, commands, choices)
        else:
            if kind == "discrete":
                self._look_up(given, commands)
            else:
                self._scale(given, commands)
            if choices.size:
                preferences.obey(commands, self.sides, choices)
        self.cap(commands, choices, self.limits)

    def cap(self, commands: Any, choices: Any, limits: CommandLimits) -> None:
        """Cap the speeds of discrete actions at each robot's limits; takes arrays or tensors."""
        if self._config.action_type == "discrete" and self._fleet:
            commands[..., 0] = commands[..., 0].clip(limits.slowest, limits.fastest)
            for column in (preferences.SPEED, preferences.GOING):
                choices[..., column] = choices[..., column].clip(limits.slowest[:, None], limits.fastest[:, None])

    def shortened(self, actions: ArrayLike) -> NDArray[Any]:
        """Return a compact form that decodes alike: preferences become ranks uint16[B, N, A]."""
        given = np.array(actions)
        if self._config.action_type != "discrete" or given.ndim != 3:
            return given
        liked = given.astype(np.float32)
        return np.asarray((liked[..., :, None] > liked[..., None, :]).sum(axis=-1, dtype=np.uint16))

    def _rank(self, given: NDArray[Any], commands: NDArray[np.float32], choices: NDArray[np.float32]) -> None:
        """Decode preferences float[B, N, A], or uint16 of `shortened`."""
        shape = (*commands.shape[:2], len(self.table))
        if given.shape != shape:
            raise ActionError(f"preferences must have the shape {shape}, not {given.shape}")
        if np.isnan(given).any():
            raise ActionError("preferences must be numbers; some are nan")
        order = np.empty(len(self.sides), np.int64)
        preferences.rank(self.table, self.sides, given.astype(np.float32), commands, choices, order)

    def _look_up(self, given: NDArray[Any], commands: NDArray[np.float32]) -> None:
        """Decode discrete actions int[B, N]."""
        shape = commands.shape[:2]
        if given.shape != shape or given.dtype.kind not in "iu":
            raise ActionError(
                f"discrete actions must be whole numbers of shape {shape}, not {given.dtype} {given.shape}"
            )
        if not given.dtype.isnative:  # as a file of another machine holds them
            given = given.astype(given.dtype.newbyteorder("="))
        if not _look_up(self.table, given, commands):
            raise ActionError(
                f"discrete actions must lie in 0..{len(self.table) - 1}, not {given.min()}..{given.max()}"
            )

    def _scale(self, given: NDArray[Any], commands: NDArray[np.float32]) -> None:
        """Decode continuous or raw actions float[B, N, 2]."""
        kind = self._config.action_type
        if given.shape != commands.shape or given.dtype.kind not in "fiu":
            raise ActionError(
                f"{kind} actions must be numbers of shape {commands.shape}, not {given.dtype} {given.shape}"
            )
        if not np.isfinite(given).all():
            raise ActionError(f"{kind} actions must be finite; some are nan or infinite")
        self.write_scaled(np.clip(given, -1, 1), commands, self.limits)

    def write_scaled(self, given: Any, commands: Any, limits: CommandLimits, where: Any = np.where) -> None:
        """Write the commands of continuous or raw actions in [-1, 1]: arrays [B, N, 2], or tensors with their `where`,
        which returns float64 as NumPy's does.
        """
        first, second = given[..., 0], given[..., 1]
        if self._config.action_type == "raw":
            commands[..., 0] = first * limits.hardest
            commands[..., 1] = second * limits.quickest
            return
        span = where(first >= 0, limits.fastest - limits.cruise, limits.cruise - limits.slowest)
        commands[..., 0] = limits.cruise + first * span
        commands[..., 1] = second * self._widest
