"""Set up the environment of all tests before any heavy import."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

from platformdirs import user_cache_dir

# Two Numba threads, so that tests can compare one thread with two; one thread for BLAS and torch, since pytest
# already runs one process per core.
os.environ["NUMBA_NUM_THREADS"] = "2"
for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
# No window, no sound, no screen.
os.environ["MPLBACKEND"] = "Agg"
os.environ["SDL_VIDEODRIVER"] = "dummy"
os.environ["SDL_AUDIODRIVER"] = "dummy"
# The command line prints plain, wide text on every terminal.
os.environ["NO_COLOR"] = "1"
os.environ["COLUMNS"] = "200"
os.environ.pop("FORCE_COLOR", None)

# Tests share the user's cache of compiled kernels.
os.environ.setdefault("NUMBA_CACHE_DIR", user_cache_dir("warehouse_env"))
# Plans and fonts are cached in a folder of this session and its worker processes, not in the user's cache.
_SESSION_CACHE = "WAREHOUSE_TEST_SESSION"
_owns_cache = _SESSION_CACHE not in os.environ
if _owns_cache:
    os.environ[_SESSION_CACHE] = tempfile.mkdtemp(prefix="warehouse-tests-")
for _name in ("WAREHOUSE_CACHE_DIR", "XDG_CACHE_HOME"):
    os.environ[_name] = os.environ[_SESSION_CACHE]

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

# The same examples in every run; no deadline, since the first call of a kernel compiles it.
settings.register_profile("warehouse", derandomize=True, deadline=None, database=None)
settings.load_profile("warehouse")


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove the session's cache folder in the process that made it."""
    if _owns_cache:
        shutil.rmtree(os.environ.pop(_SESSION_CACHE), ignore_errors=True)


@pytest.fixture(scope="session")
def two_nodes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Yield a Ray cluster with its own home: a head without jobs and two nodes of two cores each."""
    pytest.importorskip("ray")
    with tempfile.TemporaryDirectory(prefix="ray-") as folder:  # a short path, since it holds sockets
        own = {
            "HOME": str(tmp_path_factory.mktemp("home")), "RAY_USAGE_STATS_ENABLED": "0", "RAY_AUTH_MODE": "disabled",
            "PYTHONPATH": str(Path(__file__).parent.parent), "RAY_TMPDIR": folder,
        }  # fmt: skip
        temp_dir = Path(folder, "ray")
        temp_dir.mkdir()  # Ray writes the cluster's address here but does not create the folder
        with mock.patch.dict(os.environ, own):
            from ray.cluster_utils import Cluster

            soon = {
                "health_check_initial_delay_ms": 0, "health_check_period_ms": 200, "health_check_failure_threshold": 3
            }  # fmt: skip  # detect a lost node fast
            head = {"num_cpus": 0, "temp_dir": str(temp_dir), "include_dashboard": False, "_system_config": soon}
            cluster = Cluster(initialize_head=True, head_node_args=head)
            for _ in range(2):
                cluster.add_node(num_cpus=2)
            yield cluster
            cluster.shutdown()


@pytest.fixture(scope="session")
def connected_nodes(two_nodes: Any) -> Iterator[Any]:
    """Yield the cluster with this process connected, so that its workers stay warm between tests."""
    from train.evaluation.cluster import connected

    with connected(two_nodes.address):
        yield two_nodes


@pytest.fixture
def registries(tmp_path: Path) -> Iterator[None]:
    """Restore the registries after a test and drop the modules imported from its folder."""
    from agents import POLICIES
    from train.execute.lifelong import GRID_PLANNERS
    from warehouse_env import LAYOUTS, PLANNERS
    from warehouse_env.observation import SENSORS
    from warehouse_env.plugins import LOADED
    from warehouse_env.simulation.tasks.sampled import TASKS

    path = list(sys.path)
    with contextlib.ExitStack() as stack:
        for registry in (LAYOUTS, PLANNERS, POLICIES, SENSORS, TASKS, GRID_PLANNERS, LOADED):
            stack.enter_context(mock.patch.dict(registry))
        yield
    sys.path[:] = path
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None) or "").startswith(str(tmp_path)):
            del sys.modules[name]
