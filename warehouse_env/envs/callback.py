"""stable-baselines3: log the metrics of ended episodes, for example in TensorBoard."""

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from warehouse_env.envs.infos import EPISODE_METRICS

_PREFIXES = {EPISODE_METRICS: "robot", "world_metrics": "world"}  # of the keys of an info


class MetricsCallback(BaseCallback):
    """Logs the metrics of the episodes that ended: `model.learn(..., callback=MetricsCallback())`.

    "robot/...": means over robots (metrics.robot_rows), with any of our environments; "world/...": means over worlds
    (metrics.episode_row), with `vec_env`. Each is over the episodes that ended since the logger last wrote and have
    the figure: an episode without a goal has no path length.
    """

    def _on_step(self) -> bool:
        """Record the rows of this step; return True, to continue."""
        for row in np.flatnonzero(self.locals["dones"]).tolist():
            info = self.locals["infos"][row]
            for key, prefix in _PREFIXES.items():
                for name, value in info.get(key, {}).items():
                    self.logger.record_mean(f"{prefix}/{name}", value)
        return True
