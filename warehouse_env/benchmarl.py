"""BenchMARL: its own command line with the layouts as tasks. Needs the package benchmarl.

python -m warehouse_env.benchmarl algorithm=mappo task=warehouse/paper46
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from importlib.util import find_spec

import hydra
from benchmarl.environments import Task, TaskClass, task_config_registry
from benchmarl.hydra_config import load_experiment_from_hydra
from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig
from torchrl.data import Composite
from torchrl.envs import EnvBase

from warehouse_env.config import LEARNING, EnvConfig
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.layouts import LAYOUTS
from warehouse_env.torchrl import GROUP, WarehouseEnv, torchrl_env

DEFAULTS = LEARNING.replace(num_agents=16, max_steps=300)  # of a task; its options are EnvConfig's fields


class WarehouseTaskClass(TaskClass):  # type: ignore[misc]
    """Robots of one floor, under one shared policy; `config` holds fields of EnvConfig."""

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: str
    ) -> Callable[[], EnvBase]:
        """Return a function that makes the env; "cuda" as the device puts the worlds on a GPU."""
        kind = "continuous" if continuous_actions else "discrete"
        config = EnvConfig.from_dict({**self.config, "action_type": kind})
        return lambda: torchrl_env(num_envs, config, device=str(device), seed=seed)

    def supports_continuous_actions(self) -> bool:
        """Return True: residuals of speed and offset."""
        return True

    def supports_discrete_actions(self) -> bool:
        """Return True: speed levels times lateral offsets."""
        return True

    def max_steps(self, env: WarehouseEnv) -> int:
        """Return the length of an evaluation's rollout."""
        return int(env.config.max_steps)

    def has_render(self, env: WarehouseEnv) -> bool:
        """Return False: `warehouse record` makes films."""
        return False

    def group_map(self, env: WarehouseEnv) -> dict[str, list[str]]:
        """Return the one group of all robots."""
        return dict(env.group_map)

    def observation_spec(self, env: WarehouseEnv) -> Composite:
        """Return the spec of what a robot observes."""
        spec = env.full_observation_spec_unbatched.clone()
        del spec["state"], spec[GROUP, "mask"]
        return spec

    def state_spec(self, env: WarehouseEnv) -> Composite:
        """Return the spec of what a central critic sees."""
        return Composite({"state": env.full_observation_spec_unbatched["state"]})

    def action_spec(self, env: WarehouseEnv) -> Composite:
        """Return the spec of the robots' actions."""
        return env.full_action_spec_unbatched

    def info_spec(self, env: WarehouseEnv) -> None:
        """Return None: there are no infos."""

    def action_mask_spec(self, env: WarehouseEnv) -> None:
        """Return None: every action is allowed at any time."""

    @staticmethod
    def env_name() -> str:
        """Return what stands before the slash in a task's name."""
        return "warehouse"


class _Floors(Task):  # type: ignore[misc]
    @staticmethod
    def associated_class() -> type[WarehouseTaskClass]:
        return WarehouseTaskClass


WarehouseTask = _Floors("WarehouseTask", [name.upper() for name in LAYOUTS], module=__name__)


def register() -> None:
    """Add a task for each layout to BenchMARL's registry and to hydra's options."""
    for name in LAYOUTS:
        task_config_registry[f"warehouse/{name}"] = WarehouseTask[name.upper()]
        node = DEFAULTS.replace(layout=name).to_dict()
        del node["action_type"]  # BenchMARL chooses: experiment.prefer_continuous_actions
        ConfigStore.instance().store(group="task/warehouse", name=name, node=node, package="task")


@hydra.main(version_base=None, config_path="pkg://benchmarl.conf", config_name="config")  # type: ignore[untyped-decorator]
def main(options: DictConfig) -> None:
    """Run the experiment that the command line describes; a wrong value ends it in one sentence."""
    if find_spec("wandb") is None:  # which BenchMARL logs to unless told otherwise
        options.experiment.loggers = [name for name in options.experiment.loggers if name != "wandb"]
    warnings.filterwarnings("ignore", "TaskConfig python dataclass not found")  # EnvConfig checks instead
    try:
        experiment = load_experiment_from_hydra(options, task_name=HydraConfig.get().runtime.choices.task)
    except (WarehouseError, ValueError) as error:
        raise SystemExit(f"error: {' '.join(str(error).split())}") from None
    experiment.run()


if __name__ == "__main__":
    from warehouse_env import benchmarl  # pickled names then hold in any process

    benchmarl.register()
    benchmarl.main()
