"""A render_mode without the packages that pictures need: said when the env is made, not at the first picture."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import gymnasium
import pytest

from warehouse_env import EnvConfig, aec_env, parallel_env, single_env, vec_env
from warehouse_env.errors import ConfigError, WarehouseError

FACTORIES: dict[str, Callable[..., Any]] = {
    "parallel_env": parallel_env,
    "aec_env": aec_env,
    "single_env": single_env,
    "vec_env": lambda config, **options: vec_env(2, config, **options),
    "gymnasium.make": lambda config, **options: gymnasium.make("Warehouse-v0", config=config, **options),
    "gymnasium.make_vec": lambda config, **options: gymnasium.make_vec("Warehouse-v0", 1, config=config, **options),
}


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """No package of the extra `render` is installed."""
    for package in ("pygame", "matplotlib", "imageio_ffmpeg"):
        monkeypatch.setitem(sys.modules, package, None)


@pytest.mark.parametrize("mode", ["rgb_array", "human"])
@pytest.mark.parametrize("factory", FACTORIES)
def test_a_missing_package_is_named_at_once(factory: str, mode: str, tiny: EnvConfig, bare: None) -> None:
    with pytest.raises(WarehouseError) as caught:
        FACTORIES[factory](tiny, render_mode=mode)
    assert str(caught.value) == "pictures need the package 'pygame'; pip install \"warehouse-env[render]\""


@pytest.mark.parametrize("factory", FACTORIES)
def test_without_pictures_no_package_is_missed(factory: str, tiny: EnvConfig, bare: None) -> None:
    FACTORIES[factory](tiny).reset()


def test_a_wrong_mode_is_named_first(tiny: EnvConfig, bare: None) -> None:
    with pytest.raises(ConfigError, match="rgb_array"):
        parallel_env(tiny, render_mode="rgb_aray")
