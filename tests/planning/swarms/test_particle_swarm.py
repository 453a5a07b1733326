"""The particle swarm: its equation by hand, and what it reaches."""

from __future__ import annotations

import numpy as np
import pytest

from tests.planning.swarms.recorder import TARGET, Recorder
from warehouse_env.planning.swarms.particle_swarm import ParticleSwarm


def test_velocity_and_place_by_hand() -> None:
    swarm = ParticleSwarm(iterations=3, particles=2, waypoints=1, speed_limit=0.5, own_pull=1.0, swarm_pull=2.0)
    paths = Recorder()
    swarm.search(paths, np.array([[[2.0, 4.0]], [[6.0, 3.0]]]), np.random.default_rng(1))
    rng = np.random.default_rng(1)
    first, second, third = paths.tried
    # No particle moves of its own at first, and each is at its own best; the first one leads, 1 off against 4.
    pulls = rng.random((2, 2, 1, 2))
    assert (second[0] == first[0]).all()
    assert second[1] == pytest.approx(first[1] + np.clip(2.0 * pulls[1, 1] * (first[0] - first[1]), -5.5, 5.5))
    # Then, with the middle one of three inertias.
    off = [np.abs(code[1] - TARGET).sum() for code in (first, second)]
    own, leads = second[1] if off[1] < off[0] else first[1], second[1] if off[1] < 1.0 else first[0]
    pulls = rng.random((2, 2, 1, 2))
    velocity = 0.65 * (second[1] - first[1]) + pulls[0, 1] * (own - second[1]) + 2.0 * pulls[1, 1] * (leads - second[1])
    assert third[1] == pytest.approx(np.clip(second[1] + np.clip(velocity, -5.5, 5.5), 0, 10))
