"""The episodes that `make bounds` drives with all indices checked cover all options, and negative indices count."""

from __future__ import annotations

import dataclasses

import numba
import numpy as np
import pytest
from numba.np import arrayobj

from tests import bounds
from warehouse_env.config import EnvConfig


def test_the_episodes_cover_every_option() -> None:
    names = {field.name for field in dataclasses.fields(EnvConfig)}
    drawn = [bounds.options_of(number) for number in range(100)]
    assert set(bounds.CHOICES) == names
    assert {name for name in names if len({repr(getattr(config, name)) for config, _ in drawn}) > 1} == names
    floors = [grid for _, grid in drawn if grid is not None]
    assert any(grid.shape == (3, 3) for grid in floors)
    assert any(len(grid.discs) for grid in floors)
    assert any(grid.speed is not None for grid in floors)


@pytest.mark.parametrize("index", [-1, 3])
def test_an_index_out_of_range_is_an_error_negative_ones_as_well(index: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrayobj, "fix_integer_index", arrayobj.fix_integer_index)  # put back afterwards
    bounds.check_negative_indices()
    entry = numba.njit(lambda array, k: array[k], boundscheck=True)
    assert entry(np.arange(3), 2) == 2
    with pytest.raises(IndexError):
        entry(np.arange(3), index)
