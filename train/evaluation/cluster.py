"""Jobs done as tasks on the nodes of a Ray cluster.

Only this process writes files. A job's input files travel with it, so nodes need the same program and nothing else.
"""

import contextlib
import importlib.metadata
import importlib.util
import os
import platform
import re
import signal
import socket
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any

from train.evaluation.jobs import Job, Numbered, Progress, Result, code_of, lost_jobs
from train.job_files import JobFiles, Typed, pack, take_in, taken_in, unpacked
from train.reporting.report import tell
from warehouse_env import __version__
from warehouse_env.errors import ConfigError, WarehouseError, counted, shown

AUTO = "auto"
_ADDRESS = re.compile(r"[^\s:/]+:\d{1,5}|\[[0-9a-fA-F:]+\]:\d{1,5}")
_TRIES = 4  # of a job whose worker or node is lost
_WAIT = 0.2  # [s] between two looks at the tasks
_CONNECT_SECONDS = 10.0
_PACKAGES = ("warehouse_env", "agents", "train")
_LIBRARIES = ("numpy", "numba", "llvmlite", "torch")

Code = dict[str, str]
"""The versions of Python, of this project and of what it computes with, and a digest of our sources."""


class Cluster:
    """The cores of a cluster, connected to at the first job (see `Workers`). Ray repeats the jobs of lost workers."""

    def __init__(self, address: str, prepare: Callable[[], None] | None = None) -> None:
        """Take a cluster: AUTO, the one that this machine belongs to; or HOST:PORT.

        prepare: called once on each node before any job, as to compile kernels.
        """
        self.address, self._prepare = address, prepare
        self._opened = contextlib.ExitStack()
        self._ray: Any = None
        self._under_way: dict[Any, Numbered] = {}  # by the references to their results

    @property
    def width(self) -> int:
        """Cores of all nodes that are there now, at least 1."""
        if self._ray is None:
            self._ray = self._opened.enter_context(connected(self.address))
            nodes, cores = _prepare_nodes(self._ray, self._prepare), self._ray.cluster_resources().get("CPU", 0)
            tell(f"{counted(nodes, 'node')} with {counted(int(cores), 'core')}")
        return max(1, int(self._ray.cluster_resources().get("CPU", 0)))

    def each(self, jobs: Sequence[Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
        """Do the jobs (see `Workers.each`). Their times are left empty: the machines do other work as well."""
        width, ray, files, lost = self.width, self._ray, dict[tuple[str, ...], Any](), list[Job]()
        task, done, title = ray.remote(_work).options(num_cpus=1, max_retries=_TRIES - 1), 0.0, "workers start"
        for number, job in jobs:
            if job.files not in files:
                files[job.files] = ray.put(pack(job.files))
            self._under_way[task.remote(job, files[job.files], taken_in(), code_here())] = number, job
        while self._under_way:
            sent = list(self._under_way)
            for reference in ray.wait(sent, num_returns=len(sent), timeout=_WAIT, fetch_local=False)[0]:
                number, job = self._under_way.pop(reference)
                try:
                    result: Result = ray.get(reference)
                except ray.exceptions.RayTaskError as error:
                    raise error.cause from None
                except ray.exceptions.RayError:
                    lost.append(job)
                    continue
                done, title = done + job.size, job.title
                rows = [row | {name: None for name in job.times if name in row} for row in result.rows]
                yield number, result._replace(rows=rows)
            moved(done, f"{width} at a time · {title}")
        if lost:
            raise lost_jobs(lost, len(jobs), _TRIES)

    def close(self) -> None:
        """Cancel all jobs and leave the cluster."""
        for reference in self._under_way:
            self._ray.cancel(reference, force=True)
        self._under_way.clear()
        self._opened.close()
        self._ray = None


def check_address(ray: str) -> None:
    """Raise ConfigError for a wrong address of a cluster, or if Ray is not installed."""
    if ray != AUTO and not _ADDRESS.fullmatch(ray):
        raise ConfigError(f"--ray {shown(ray)} must be {AUTO} or HOST:PORT; --processes is for this machine alone")
    if importlib.util.find_spec("ray") is None:
        raise ConfigError('--ray needs the package ray: pip install "warehouse-env[ray]"')


@contextlib.contextmanager
def connected(address: str) -> Iterator[Any]:
    """Connect this process to a cluster; yields the library. Raises WarehouseError in one sentence if it cannot.

    Where this process is connected already, that connection is used, and stays.
    """
    if "ray" in sys.modules and (ray := sys.modules["ray"]).is_initialized():
        yield ray
        return
    _check_there(address)
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # else it warns of what a later version will do
    os.environ.setdefault("RAY_task_oom_retries", str(_TRIES - 1))  # else a job that needs too much memory never ends
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="warehouse-", ignore_cleanup_errors=True))
        import ray

        before = signal.getsignal(signal.SIGTERM)
        try:
            with contextlib.chdir(folder):  # Ray has workers look for modules here first: nowhere is best
                ray.init(address, log_to_driver=False, configure_logging=False)
        except (OSError, RuntimeError, ValueError) as error:  # ConnectionError is an OSError
            joins = "this machine must belong to the cluster: `ray start --address HOST:PORT` has it join one"
            raise WarehouseError(f"--ray {address}: {_first_line(error)}; {joins}") from None
        stack.callback(ray.shutdown)
        if before is not None:
            with contextlib.suppress(ValueError):  # not in the main thread
                signal.signal(signal.SIGTERM, before)  # else Ray's own would end this process before rows are closed
        yield ray


def _check_there(address: str) -> None:
    """Raise WarehouseError where nobody answers at HOST:PORT, which Ray itself finds out in minutes."""
    if address == AUTO:
        return
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_SECONDS).close()
    except (OSError, OverflowError) as error:
        raise WarehouseError(
            f"--ray {address}: nobody answers there ({error}); `ray start --head --port {port}` there begins a cluster"
        ) from None


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")


def _prepare_nodes(ray: Any, prepare: Callable[[], None] | None) -> int:
    """Check and prepare all nodes; return their number. WarehouseError if there is none, or one has other code."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    sent = {}
    for node in ray.nodes():
        if node["Alive"] and node["Resources"].get("CPU", 0) >= 1:
            on = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
            task = ray.remote(_prepare_node).options(num_cpus=0, scheduling_strategy=on)
            sent[f"{node['NodeManagerAddress']} ({node['NodeID'][:6]})"] = task.remote(code_here(), prepare)
    ready = 0
    for node, reference in sent.items():
        with contextlib.suppress(ray.exceptions.RayError):  # the node is gone
            try:
                ray.get(reference)
                ready += 1
            except ray.exceptions.RayTaskError as error:
                raise WarehouseError(
                    f"node {node} cannot do the jobs: {_first_line(error.cause)}; install the same version there"
                ) from None
    if not ready:
        raise WarehouseError("the cluster has no node with a free core: add one by `ray start --address HOST:PORT`")
    return ready


def _prepare_node(code: Code, prepare: Callable[[], None] | None) -> None:
    check_code(code, code_here())
    if prepare is not None:
        prepare()


def _work(job: Job, files: JobFiles, typed: list[Typed], code: Code) -> Result:
    """Do a job on a node, on one thread, with the files that came with it."""
    from warehouse_env.threads import set_num_threads

    set_num_threads(1)
    check_code(code, code_here())  # the node may be new
    with unpacked(files):
        take_in(typed)
        return job.run(lambda part: None)


@cache
def code_here() -> Code:
    """Return what this process runs."""
    libraries = {name: importlib.metadata.version(name) for name in _LIBRARIES}
    own = {"warehouse_env": __version__, "sources": code_of(*_PACKAGES)}
    return {"python": platform.python_version(), **libraries, **own}


def check_code(here: Code, there: Code) -> None:
    """Raise WarehouseError unless a node has the code and the library versions of this machine."""
    differs = [name for name in here if there.get(name) != here[name]]
    if differs:
        theirs, ours = (", ".join(f"{name} {code.get(name)}" for name in differs) for code in (there, here))
        raise WarehouseError(f"it has {theirs}, here it is {ours}")
