"""Gymnasium: robot 0 learns, the others follow a given rule."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Unpack

import gymnasium
import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.envs.camera import FilmedWorld
from warehouse_env.envs.infos import EPISODE_METRICS, RobotInfos, final_metrics
from warehouse_env.envs.options import ActionPacker, WorldOptions, build, reset
from warehouse_env.errors import ActionError
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.given import whole_seed

Others = Callable[[NDArray[np.float32]], Any]


class WarehouseSingleEnv(FilmedWorld, gymnasium.Env[NDArray[np.float32], Any]):
    """A warehouse from the view of one robot among others.

    The episode terminates when robot 0 does (one-shot arrival) and is truncated at `max_steps`. The last info holds
    the metrics of robot 0's episode under "episode_metrics" (see infos.final_metrics).
    """

    bound = ("_infos",)

    def __init__(
        self,
        config: EnvConfig | None = None,
        *,
        others: Others | None = None,
        render_mode: str | None = None,
        **options: Unpack[WorldOptions],
    ) -> None:
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
