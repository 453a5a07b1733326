"""How long it takes to load or unload a robot."""

from __future__ import annotations

import numpy as np

from warehouse_env.work import ServiceSpec


def service_time(spec: ServiceSpec | None, at_station: bool, rng: np.random.Generator) -> float:
    """Return a service's length [s]: always the mean, or gamma distributed about it; 0 where none takes time."""
    if spec is None:
        return 0.0
    mean = spec.station if at_station else spec.pick
    if spec.variation == 0 or mean == 0:
        return mean
    shape = 1.0 / spec.variation**2
    return float(rng.gamma(shape, mean / shape))
