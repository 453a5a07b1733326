"""PettingZoo: every robot is an agent; Gymnasium: robot 0 learns, others follow a rule. One Simulator of one world."""

import copy
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Unpack

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import parallel_to_aec

from warehouse_env.config import EnvConfig
from warehouse_env.envs.camera import FilmedWorld
from warehouse_env.envs.infos import EPISODE_METRICS, RobotInfos, final_metrics
from warehouse_env.envs.options import ActionPacker, WorldOptions, build, reset, robots_of
from warehouse_env.errors import ActionError, shown
from warehouse_env.simulation.given import whole_seed
from warehouse_env.simulation.simulator import Simulator

Observations = dict[str, NDArray[np.float32]]
Infos = dict[str, dict[str, Any]]


class WarehouseParallelEnv(FilmedWorld, ParallelEnv):  # type: ignore[misc]  # pettingzoo ships no types
    """Robots "robot_0".."robot_{N-1}" of one warehouse, stepped together.

    Lifelong tasks: nobody terminates, all are truncated at `max_steps`. One-shot tasks: a robot that arrives
    terminates and leaves `agents`; its body stays parked. A robot's last info holds the metrics of its episode under
    "episode_metrics" (see infos.final_metrics). Returned arrays are never overwritten. `np_random` is for wrappers
    that draw, such as SuperSuit's frame_skip_v0; the world has its own generators.
    """

    bound = ("_observation", "_reward", "_terminated", "_infos")
    metadata: ClassVar[dict[str, Any]] = {**FilmedWorld.metadata, "name": "warehouse_v0", "is_parallelizable": True}

    def __init__(
        self, config: EnvConfig | None = None, *, render_mode: str | None = None, **options: Unpack[WorldOptions]
    ) -> None:
        """Build one world from `config` with `options` put in; ConfigError or MapError says what cannot be used."""
        self._show(build(Simulator, config, options), render_mode)
        self._fleets = {self.simulator.num_agents: self.simulator}  # by their number of robots
        self.possible_agents = [f"robot_{k}" for k in range(self.simulator.num_agents)]
        self.agents: list[str] = []
        # one instance a robot, so that seeding one robot's space leaves the others' alone
        self.observation_spaces = {a: copy.deepcopy(self.simulator.observation_space) for a in self.possible_agents}
        self.action_spaces = {a: copy.deepcopy(self.simulator.action_space) for a in self.possible_agents}
        shape = self.simulator.global_state(0).shape
        self.state_space = spaces.Box(-np.inf, np.inf, shape, np.float32)
        self._idle = self.simulator.cruise_action
        self.np_random = np.random.default_rng()
        self._take(self.simulator)

    def _take(self, simulator: Simulator) -> None:
        """Step this Simulator from now on; its robots are the first of `possible_agents`."""
        self.simulator, self._names = simulator, self.possible_agents[: simulator.num_agents]
        self._blank: dict[str, Any] = dict.fromkeys(self._names)
        self._nobody = dict.fromkeys(self._names, False)
        self._actions = ActionPacker(self._names, simulator.action_space)
        self._bind()

    def _bind(self) -> None:
        """Take views of the one world; the Simulator writes its arrays in place."""
        self._observation = self.simulator.observation[0]
        self._reward = self.simulator.reward[0]
        self._terminated = self.simulator.terminated[0]
        self._infos = RobotInfos(self.simulator, self.simulator.num_agents)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the robot's own space instance, the same one at every call."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the robot's own space instance, the same one at every call."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observations, Infos]:
        """Start an episode; a seed fixes it to the bit, otherwise the generators continue.

        options: "num_agents": how many of `possible_agents` there are in this episode, by default all; "starts"
        [num_agents, 3], poses (x [m], y [m], heading [rad]), and "goals": cells, points or poses, see `Assignment`;
        without them both are drawn. ConfigError or MapError for what cannot be honoured.
        """
        probed = isinstance(options, dict) and options.keys() == {"options"}  # by PettingZoo's own API test
        options = None if probed else options
        simulator = self._fleet_of(robots_of(options, len(self.possible_agents)))
        given = seed
        if simulator is not self.simulator and seed is None:  # its own draws do not go on from the last fleet's
            given = int(self.np_random.integers(2**31))
        reset(simulator, given, options, one=True)
        if simulator is not self.simulator:
            self._take(simulator)
        if seed is not None:
            self.np_random = np.random.default_rng(seed)
        self.agents = list(self._names)
        if self.render_mode == "human":
            self.render()
        return dict(zip(self.agents, self._observation.copy(), strict=True)), {agent: {} for agent in self.agents}

    def _fleet_of(self, robots: int) -> Simulator:
        """Return the Simulator of this many robots; all use the same routes."""
        if robots not in self._fleets:
            book = self.simulator.route_book
            self._fleets[robots] = Simulator(self.config.replace(num_agents=robots), routes=book)
        return self._fleets[robots]

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Step every live robot once with its action in `actions`; actions of robots that have left are ignored.

        Raises ActionError, naming the robot, for a missing, superfluous, misshapen or non-finite action.
        """
        if not isinstance(actions, (dict, Mapping)):
            raise ActionError(f"actions {shown(actions)} must be a dict of one action for each robot")
        agents, names = self.agents, self._names
        if not agents and not actions:
            return {}, {}, {}, {}, {}
        self._advance(actions)
        ended, truncated = self._terminated.tolist(), bool(self.simulator.truncated[0])
        # a copy of a dict has room for all names: written so, they take half the time of dict(zip(...))
        observations, rewards = self._blank.copy(), self._blank.copy()
        terminations, truncations = self._nobody.copy(), self._nobody.copy()
        rows = zip(names, self._observation.copy(), self._reward.tolist())  # noqa: B905 - all [N]
        for name, observation, reward in rows:
            observations[name] = observation
            rewards[name] = reward
        infos = self._infos.unread(self._blank)
        some_ended = truncated or True in ended
        if some_ended:
            terminations = dict(zip(names, ended, strict=True))
            truncations = {name: truncated and not over for name, over in terminations.items()}
        parts = (observations, rewards, terminations, truncations, infos)
        if len(agents) < len(names):
            parts = tuple({agent: part[agent] for agent in agents} for part in parts)  # type: ignore[assignment]
        if some_ended:
            self._part_with(*parts[2:])
        if self.render_mode == "human":
            self.render()
        return parts

    def _part_with(self, terminations: dict[str, bool], truncations: dict[str, bool], infos: Infos) -> None:
        """Give the robots whose episode ended with this step their metrics, and take them from `agents`."""
        over = [agent for agent in self.agents if terminations[agent] or truncations[agent]]
        if over:
            numbers = [self.possible_agents.index(agent) for agent in over]
            for agent, row in zip(over, final_metrics(self.simulator, numbers), strict=True):
                infos[agent][EPISODE_METRICS] = row
            self.agents = [agent for agent in self.agents if agent not in over]

    def _advance(self, actions: dict[str, Any]) -> None:
        """Check the live robots' actions and step the Simulator."""
        agents, names = self.agents, self._names
        if len(actions) > len(agents):
            known = names if agents else ()  # one that has left while others drive may be given an action
            extra = next((name for name in actions if name not in known), None)
            if extra is not None:
                raise ActionError(f"action given for {extra!r}, which is not among the live agents (call reset()?)")
        try:
            if len(agents) < len(names):  # a parked robot's action is not read, but has to be there
                given = [actions[name] if name in agents else self._idle for name in names]
            else:
                given = list(map(actions.__getitem__, names))
        except KeyError as missing:
            raise ActionError(f"no action given for {missing.args[0]}") from None
        self._actions.step(self.simulator, given)

    def state(self) -> NDArray[np.float32]:
        """Return the global view of the world, for centralised critics (`Simulator.global_state`); absent robots: 0."""
        state = np.zeros(self.state_space.shape, dtype=np.float32)
        now = self.simulator.global_state(0)
        state[: len(now)] = now
        return state


parallel_env = WarehouseParallelEnv


def aec_env(
    config: EnvConfig | None = None, *, render_mode: str | None = None, **options: Unpack[WorldOptions]
) -> AECEnv:
    """Return the same env for PettingZoo's turn-based interface; the world steps after all robots have acted."""
    return parallel_to_aec(parallel_env(config, render_mode=render_mode, **options))


Others = Callable[[NDArray[np.float32]], Any]


class WarehouseSingleEnv(FilmedWorld, gymnasium.Env[NDArray[np.float32], Any]):
    """A warehouse from the view of one robot among others.

    The episode terminates when robot 0 does (one-shot arrival) and is truncated at `max_steps`. The last info holds
    the metrics of robot 0's episode under "episode_metrics" (see infos.final_metrics).
    """

    bound = ("_infos",)

    def __init__(
        self, config: EnvConfig | None = None, *, others: Others | None = None, render_mode: str | None = None,
        **options: Unpack[WorldOptions]
    ) -> None:  # fmt: skip
        """Build one world from `config` with `options` put in.

        `others` maps the other robots' observations float32[N-1, D] to their actions [N-1] or [N-1, 2];
        by default each follows its route and ignores the others. ConfigError or MapError says what cannot be used.
        """
        self._show(build(Simulator, config, options), render_mode)
        self.observation_space = self.simulator.observation_space
        self.action_space = self.simulator.action_space
        self._others = others
        self._actions = ActionPacker([f"robot_{k}" for k in range(self.simulator.num_agents)], self.action_space)
        self._started = False
        self._bind()

    def _bind(self) -> None:
        """Take views of the one world; the Simulator writes its arrays in place."""
        self._infos = RobotInfos(self.simulator, 1)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; a seed fixes it to the bit, otherwise the generators continue.

        options: starts and goals of all robots, as `WarehouseParallelEnv.reset` takes them.
        """
        seed = None if seed is None else whole_seed(seed)
        super().reset(seed=seed)
        observation = reset(self.simulator, seed, options, one=True)
        self._started = True
        if self.render_mode == "human":
            self.render()
        return observation[0, 0].copy(), {}

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Step the world once with robot 0's action; ActionError names the robot whose action cannot be used."""
        if not self._started:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        simulator = self.simulator
        self._actions.step(simulator, [action, *self._actions_of_others()])
        if self.render_mode == "human":
            self.render()
        terminated, truncated = bool(simulator.terminated[0, 0]), bool(simulator.truncated[0])
        info = self._infos.read(self._infos.keep())[0]
        if terminated or truncated:
            info[EPISODE_METRICS] = final_metrics(simulator, [0])[0]
        return simulator.observation[0, 0].copy(), float(simulator.reward[0, 0]), terminated, truncated, info

    def _actions_of_others(self) -> list[Any]:
        """Return one action for each robot but the first."""
        count = self.simulator.num_agents - 1
        if self._others is None or count == 0:
            return [self.simulator.cruise_action] * count
        actions = list(self._others(self.simulator.observation[0, 1:].copy()))
        if len(actions) != count:
            raise ActionError(f"`others` gave {len(actions)} actions for {count} robots")
        return actions


single_env = WarehouseSingleEnv
