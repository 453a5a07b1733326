"""stable-baselines3: a VecEnv whose rows are worlds x robots, all sharing one policy."""

import inspect
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Unpack

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, tile_images

from warehouse_env.config import EnvConfig
from warehouse_env.envs.camera import checked_mode, close_window, picture, render_fps
from warehouse_env.envs.infos import EPISODE_METRICS, final_metrics, finished_task, known
from warehouse_env.envs.options import WorldOptions, assignments_of, build, share_routes
from warehouse_env.envs.rows import write_rows
from warehouse_env.errors import ActionError, ConfigError, check_count, shown
from warehouse_env.simulation.given import listed, whole_seed
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment

StepResult = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]


class Block(NamedTuple):
    """Consecutive rows that one Simulator fills: row = start + world * robots + robot."""

    simulator: Simulator
    start: int
    actions: NDArray[Any]  # [B, N] or [B, N, 2], what the Simulator is given

    @property
    def rows(self) -> slice:
        """All rows of the block."""
        return slice(self.start, self.start + self.simulator.num_worlds * self.simulator.num_agents)

    def world_rows(self, world: int) -> slice:
        """The rows of one world."""
        first = self.start + world * self.simulator.num_agents
        return slice(first, first + self.simulator.num_agents)


class WarehouseVecEnv(VecEnv):
    """Many worlds in parallel, one row for each robot; worlds reset themselves.

    A world resets when it is truncated (`max_steps`) or when all its robots have terminated (one-shot tasks).
    A robot that terminates earlier ends its episode then, once, and parks. Its row is padding until its world
    resets: observation and reward are 0, actions are ignored, `infos[row]["padding"]` is True, the row is not done.

    A done row's info holds "terminal_observation", "TimeLimit.truncated", "episode" (r: return, l: steps, t: seconds)
    and "episode_metrics" (of the robot, see infos.final_metrics). The first done row of a world that resets also
    holds "world_metrics" (`Simulator.episode_metrics`). Both leave out figures that an episode does not have. At an
    arrival the info holds "path_length_m" and "planned_length_m" of the finished task. All other infos are empty.
    Returned observations and rewards are never overwritten, and notes in an info do not reappear in later steps.
    """

    def __init__(self, simulators: Sequence[Simulator], render_mode: str | None = None) -> None:
        """Put the simulators' rows one after another; ConfigError if their robots' spaces differ."""
        first = simulators[0]
        for other in simulators[1:]:
            if other.observation_space != first.observation_space or other.action_space != first.action_space:
                raise ConfigError(
                    "all configs of one vec_env need the same observation and action spaces: "
                    "give them the same sensor, action_type, speed_levels and lateral_offsets"
                )
        self._mode = checked_mode(render_mode)
        self.blocks: list[Block] = []
        rows = 0
        for simulator in simulators:
            shape = (simulator.num_worlds, simulator.num_agents, *(first.action_space.shape or ()))
            self.blocks.append(Block(simulator, rows, np.zeros(shape, dtype=first.action_space.dtype)))
            rows += simulator.num_worlds * simulator.num_agents
        self._worlds = [(simulator, world) for simulator in simulators for world in range(simulator.num_worlds)]
        self._robots = [simulator.num_agents for simulator, _ in self._worlds]
        self._of_row = [one for one in self._worlds for _ in range(one[0].num_agents)]
        self._assigned: list[Assignment] | None = None  # by the next reset
        super().__init__(rows, first.observation_space, first.action_space)
        self._blank_infos: list[dict[str, Any]] = [{} for _ in range(rows)]
        self._parked = np.zeros(rows, dtype=np.bool_)
        self._padding: list[int] = []  # the rows of parked robots
        self._returns = np.zeros(rows, dtype=np.float64)
        self._steps = 0  # of this env since it was made
        self._first = np.zeros(rows, dtype=np.int64)  # of those, the ones before each row's episode
        self._begun = np.full(rows, time.time())  # of a clock that all processes share

    def reset(self) -> NDArray[np.float32]:
        """Start every world; returns observations float32[rows, D].

        After `seed(s)` the first simulator is reset with s itself and later ones with seeds drawn from it;
        otherwise the generators go on. Starts and goals are those of `set_options`, if it was called.
        """
        seed = self._seeds[0]
        assigned, self._assigned = self._assigned, None
        observation, worlds = self._new_observation(), 0
        for k, block in enumerate(self.blocks):
            drawn = None if seed is None else int(np.random.SeedSequence([seed, k]).generate_state(1)[0])
            first, worlds = worlds, worlds + block.simulator.num_worlds
            block.simulator.reset(drawn if k else seed, assigned and assigned[first:worlds])
        self._reset_seeds()
        self._begin(slice(None))
        self._padding = []
        return observation

    def _new_observation(self) -> NDArray[np.float32]:
        """Return a new array [rows, D] that the Simulators write into from now on, to be returned without a copy."""
        observation = np.empty((self.num_envs, *(self.observation_space.shape or ())), dtype=np.float32)
        for block in self.blocks:
            block.simulator.observe_into(observation[block.rows].reshape(block.simulator.observation.shape))
        return observation

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Set the seed of the next reset; ConfigError unless it is a whole number of at least 0."""
        return list(super().seed(None if seed is None else whole_seed(seed)))

    def set_options(self, options: list[dict[str, Any]] | dict[str, Any] | None = None) -> None:
        """Give the next reset starts and goals: for each world a table, as `WarehouseParallelEnv.reset` takes it."""
        self._assigned = assignments_of(options, self._robots)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions [rows] or [rows, 2] of the next step; ActionError on a wrong shape or kind."""
        try:
            actions = np.asarray(actions)
        except ValueError:
            raise ActionError(f"actions {shown(actions)} are no array of numbers") from None
        wanted = (self.num_envs, *(self.action_space.shape or ()))
        whole = self.blocks[0].actions.dtype.kind in "iu"
        if actions.shape != wanted or actions.dtype.kind not in ("iu" if whole else "fiu"):
            kind = "whole numbers" if whole else "numbers"
            raise ActionError(f"actions of shape {actions.shape} ({actions.dtype}) given, {wanted} {kind} needed")
        if actions.dtype == np.float64:  # clipped as the Simulator would, for float32 may not hold them
            actions = np.where(np.isinf(actions), actions, np.clip(actions, -1.0, 1.0))
        for block in self.blocks:
            block.actions[:] = actions[block.rows].reshape(block.actions.shape)

    def step_wait(self) -> StepResult:
        """Step all worlds; returns observations [rows, D], rewards [rows], dones [rows] and infos."""
        observation = self._new_observation()
        reward = np.empty(self.num_envs, dtype=np.float32)
        dones = np.empty(self.num_envs, dtype=np.bool_)
        if any(self._blank_infos):  # replace only those that the user wrote into, which is faster than all
            self._blank_infos = [{} if info else info for info in self._blank_infos]
        infos = list(self._blank_infos)
        some_done = False
        for block in self.blocks:
            simulator, rows = block.simulator, block.rows
            simulator.step(block.actions)
            some_done |= write_rows(
                simulator.reward, simulator.terminated, simulator.truncated,
                reward[rows], dones[rows], self._returns[rows],
            )  # fmt: skip
            for arrival in simulator.arrivals:
                infos[block.world_rows(arrival.world).start + arrival.robot] = finished_task(arrival)
        self._steps += 1
        for row in self._padding:
            reward[row], dones[row], infos[row] = 0.0, False, {"padding": True}
        if some_done and dones.any():
            self._end_rows(infos, observation, dones)
            self._restart_worlds(infos, dones)
            self._padding = np.flatnonzero(self._parked).tolist()
        if self._padding:
            observation[self._padding] = 0.0
        return observation, reward, dones, infos

    def _end_rows(
        self, infos: list[dict[str, Any]], observation: NDArray[np.float32], dones: NDArray[np.bool_]
    ) -> None:
        """Fill the info of every done row, and mark terminated rows as parked."""
        now = time.time()
        for block in self.blocks:
            terminated = block.simulator.terminated.ravel()
            ended = np.flatnonzero(dones[block.rows])
            final = observation[block.rows][ended]  # a copy: the rows themselves may reset below
            metrics = final_metrics(block.simulator, ended)
            for robot, last, figures in zip(ended.tolist(), final, metrics, strict=True):
                row = block.start + robot
                length, seconds = self._steps - int(self._first[row]), round(now - float(self._begun[row]), 6)
                infos[row] = {
                    **infos[row], "terminal_observation": last, "TimeLimit.truncated": not terminated[robot],
                    "episode": {"r": float(self._returns[row]), "l": length, "t": seconds}, EPISODE_METRICS: figures,
                }  # fmt: skip
            self._parked[block.rows] = terminated

    def _restart_worlds(self, infos: list[dict[str, Any]], dones: NDArray[np.bool_]) -> None:
        """Reset every world whose robots have all ended; its first observations replace the last."""
        for block in self.blocks:
            simulator = block.simulator
            for world in np.flatnonzero(simulator.truncated | simulator.terminated.all(axis=1)).tolist():
                rows = block.world_rows(world)
                first = rows.start + int(np.argmax(dones[rows]))
                infos[first]["world_metrics"] = known(simulator.episode_metrics(world))
                simulator.reset_world(world)
                self._begin(rows)

    def _begin(self, rows: slice) -> None:
        """Reset the episode counters of some rows."""
        self._parked[rows] = False
        self._returns[rows] = 0.0
        self._first[rows] = self._steps
        self._begun[rows] = time.time()

    def state(self, per_row: bool = False) -> NDArray[np.float32]:
        """Return float32[worlds, S] for centralised critics, `Simulator.global_state` of each; per_row: [rows, S].

        S is N * 8 of the worlds with most robots; where a world has fewer, zeros follow.
        """
        views = [simulator.global_state(world) for simulator, world in self._worlds]
        whole = np.zeros((len(views), max(map(len, views))), dtype=np.float32)
        for row, view in zip(whole, views, strict=True):
            row[: len(view)] = view
        return np.repeat(whole, self._robots, axis=0) if per_row else whole

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return, for each chosen row, the attribute of its Simulator ("render_mode": of this env)."""
        rows = self._get_indices(indices)
        if attr_name == "render_mode":
            return [self._mode for _ in rows]
        return [getattr(self._of_row[row][0], attr_name) for row in rows]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the Simulators that hold the chosen rows."""
        for row in self._get_indices(indices):
            setattr(self._of_row[row][0], attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method once on each Simulator that holds a chosen row; returns the result for each such row.

        A method that takes a world, as `global_state` and `episode_metrics` do, is called once for each chosen row's
        world instead, unless the arguments name one.
        """
        results: dict[tuple[Simulator, int | None], Any] = {}
        asked = list[tuple[Simulator, int | None]]()
        for row in self._get_indices(indices):
            simulator, world = self._of_row[row]
            method = getattr(simulator, method_name)
            own = {"world": world} if _takes_world(method, *method_args, **method_kwargs) else {}
            asked.append((simulator, own.get("world")))
            if asked[-1] not in results:
                results[asked[-1]] = method(*method_args, **method_kwargs, **own)
        return [results[one] for one in asked]

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return for each chosen row whether it is wrapped: True for `Monitor`, whose "episode" the infos hold."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return one picture for each world (not row), or None without a render mode."""
        return [picture(simulator, world) if self._mode else None for simulator, world in self._worlds]

    def render(self, mode: str | None = None) -> NDArray[np.uint8] | None:
        """Return the pictures of all worlds as one uint8[H, W, 3] ("rgb_array"), or show it ("human")."""
        if self._mode != "human":
            return super().render(mode)
        from warehouse_env.render.video import show

        show(tile_images([picture(*one) for one in self._worlds]), render_fps(self._worlds[0][0].config))
        return None

    def close(self) -> None:
        """Close the window, if pictures are shown in one."""
        close_window(self._mode)


def _takes_world(method: Callable[..., Any], *arguments: Any, **options: Any) -> bool:
    """Return whether a method has a parameter `world` that the arguments do not set."""
    signature = inspect.signature(method)
    return "world" in signature.parameters and "world" not in signature.bind_partial(*arguments, **options).arguments


def vec_env(
    num_worlds: int | Sequence[int] = 1, config: EnvConfig | None = None, *, configs: Sequence[EnvConfig] | None = None,
    render_mode: str | None = None, **options: Unpack[WorldOptions]
) -> WarehouseVecEnv:  # fmt: skip
    """Return a VecEnv of `num_worlds` worlds, e.g. `vec_env(64, num_agents=16, layout="narrow")`.

    `configs` mixes several warehouses (layouts, robot counts) in one VecEnv: `num_worlds` worlds of each, or a
    list with one number for each. `options` go into every config. ConfigError says what cannot be used.
    """
    if configs is not None and config is not None:
        raise ConfigError("give either config or configs, not both")
    chosen = [EnvConfig() if config is None else config] if configs is None else listed(configs)
    if chosen is None:
        raise ConfigError(f"configs={shown(configs)} must be a list of EnvConfigs")
    counts = listed(num_worlds) or [num_worlds] * len(chosen)
    if not chosen or len(counts) != len(chosen):
        raise ConfigError(f"num_worlds={shown(num_worlds)} needs one number for each of the {len(chosen)} configs")
    counts = [check_count("num_worlds", count) for count in counts]
    simulators = [build(Simulator, one, options, count) for one, count in zip(chosen, counts, strict=True)]
    share_routes(simulators)
    return WarehouseVecEnv(simulators, render_mode)
