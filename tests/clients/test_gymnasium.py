"""Gymnasium: its vector envs, in this process and in others."""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

ID = "warehouse_env:Warehouse-v0"  # the module before the name: so a process that has not imported it finds it


@pytest.mark.parametrize("start", ["fork", pytest.param("spawn", marks=pytest.mark.nightly)])
def test_both_vector_envs_give_the_same(small: dict[str, Any], start: str) -> None:
    """Through the end of an episode and into the next; the same as one env alone."""
    make = partial(gymnasium.make, ID, **small)
    sync, others, alone = SyncVectorEnv([make] * 2), AsyncVectorEnv([make] * 2, context=start), make()
    first, second = sync.reset(seed=[3, 4])[0], others.reset(seed=[3, 4])[0]
    np.testing.assert_array_equal(first[0], alone.reset(seed=3)[0])
    ends = 0
    for k in range(50):
        np.testing.assert_array_equal(first, second)
        actions = np.array([17, k % 20])
        (first, *mine), (second, *its) = sync.step(actions), others.step(actions)
        for part in range(3):
            np.testing.assert_array_equal(mine[part], its[part])
        if not ends:
            np.testing.assert_array_equal(first[0], alone.step(17)[0])
        ends += int(mine[2].sum())
    assert ends == 2
    sync.close()
    others.close()
