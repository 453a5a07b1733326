"""Events -> named terms -> weighted sum."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RewardWeights
from warehouse_env.kernel import inline
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO

REWARD_TERMS = tuple(f.name for f in dataclasses.fields(RewardWeights))


def weight_vector(weights: RewardWeights) -> NDArray[np.float32]:
    """Return the weights in the order of REWARD_TERMS."""
    return np.array([getattr(weights, name) for name in REWARD_TERMS], dtype=np.float32)


@inline
def write_terms(r, p, weights, terms):
    """Write a robot's weighted terms in the order of REWARD_TERMS; return their sum, 0 for a parked robot.

    progress [m]; arrival 0|1; collision: contact episodes that began; contact 0|1; proximity: 1 at gap 0, 0 from
    near_miss_gap x 3 on; time 1; smoothness: change of commanded speed / max_speed + of steering / max_steering;
    path_length [m] driven in any direction.
    """
    commanded, events = r["commanded"], r["events"]
    if r["task"]["acting"] == 0:
        terms[:] = ZERO
        return ZERO
    near = np.float32(3.0) * p["near_miss_gap"]
    terms[0] = weights[0] * events["progress"]
    terms[1] = weights[1] * np.float32(events["arrived"])
    terms[2] = weights[2] * np.float32(events["hit_robot"] + events["hit_shelf"] + events["hit_person"])
    terms[3] = weights[3] * np.float32(events["touching"])
    terms[4] = weights[4] * max(ZERO, ONE - events["gap"] / near)
    terms[5] = weights[5]
    terms[6] = weights[6] * (
        abs(commanded["target_speed"] - commanded["previous_speed"]) / p["max_speed"]
        + abs(commanded["target_steer"] - commanded["previous_steer"]) / p["max_steer"]
    )
    terms[7] = weights[7] * events["driven"]
    total = ZERO
    for k in range(terms.shape[0]):
        total += terms[k]
    return total
