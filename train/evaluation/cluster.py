"""Jobs done as tasks on the nodes of a Ray cluster.

Only this process writes files. A job's input files travel with it, so nodes need the same program and nothing else.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import Any

from train.evaluation.jobs import Job, Result
from train.evaluation.nodes import Node, about_this_node, check_node
from train.evaluation.remote import WAIT, RemoteWorkers
from train.job_files import JobFiles, pack, unpacked
from train.own import Typed, take_in, taken_in
from train.reporting.report import counted, tell
from warehouse_env.errors import WarehouseError

AUTO, LOCAL = "auto", "local"
_AHEAD = 2  # jobs sent for each core, so that no core waits for its next one
_CONNECT_SECONDS = 10.0
_LONGEST_FOLDER = 20  # letters of a temporary folder's name, which leave room for the 107 of a socket's


class Cluster(RemoteWorkers):
    """The cores of a cluster, connected to at the first job."""

    tries = 4

    def __init__(self, address: str, prepare: Callable[[], None] | None = None, cores: int | None = None) -> None:
        """Take a cluster: LOCAL, one of this machine alone; AUTO, the one that this machine belongs to; or HOST:PORT.

        prepare: called once on each node before any job, as to compile kernels. cores: of LOCAL; all if left out.
        """
        self.address, self._prepare, self._cores = address, prepare, cores
        self._opened = contextlib.ExitStack()
        self._ray: Any = None
        self._task: Any = None
        self._files: dict[tuple[str, ...], Any] = {}
        self._jobs: dict[Any, Job] = {}  # under way, by their references

    @property
    def width(self) -> int:
        """Cores of all nodes that are there now, at least 1."""
        return max(1, self._connected_cores())

    @property
    def room(self) -> int:
        """Jobs that may be under way: none while no node is there."""
        return _AHEAD * self._connected_cores()

    def close(self) -> None:
        """Cancel all jobs and leave the cluster; one of this machine alone ends, and leaves nothing behind."""
        for reference in self._jobs:
            self._ray.cancel(reference, force=True)
        self._jobs.clear()
        self._files.clear()
        self._opened.close()
        self._ray = None
        if self.sent_again:
            tell(f"{counted(self.sent_again, 'job')} sent again, because a worker or node was lost")
            self.sent_again = 0

    def send(self, job: Job) -> Any:
        """Send a job with its files; return the reference to its result."""
        if job.files not in self._files:
            self._files[job.files] = self._ray.put(pack(job.files))
        reference = self._task.remote(job, self._files[job.files], taken_in(), about_this_node())
        self._jobs[reference] = job
        return reference

    def ended(self) -> Iterator[tuple[Any, Result | None]]:
        """Yield the jobs that ended, without their times: the machines do other work as well."""
        if not self._jobs:
            time.sleep(WAIT)  # for a node
            return
        self._ray.wait(list(self._jobs), timeout=WAIT, fetch_local=False)
        for reference in self._ray.wait(list(self._jobs), num_returns=len(self._jobs), timeout=0.0)[0]:
            job = self._jobs.pop(reference)
            try:
                result: Result = self._ray.get(reference)
            except self._ray.exceptions.RayTaskError as error:
                raise error.cause from None
            except self._ray.exceptions.RayError:
                yield reference, None
                continue
            rows = [row | {name: None for name in job.times if name in row} for row in result.rows]
            yield reference, result._replace(rows=rows)

    def _connected_cores(self) -> int:
        """Return the cores that are there now, after connecting if need be."""
        if self._ray is None:
            self._ray = self._opened.enter_context(joined(self.address, self._prepare, self._cores))
            self._task = self._ray.remote(_work).options(num_cpus=1, max_retries=0)
        return int(self._ray.cluster_resources().get("CPU", 0))


@contextlib.contextmanager
def joined(address: str, prepare: Callable[[], None] | None = None, cores: int | None = None) -> Iterator[Any]:
    """Connect to a cluster, check and prepare all its nodes; yield the library.

    The arguments are those of Cluster. WarehouseError names a node that has other code.
    """
    with connected(address, cores) as ray:
        here = about_this_node()
        processors = _on_each_node(ray, here, prepare)
        if not processors:
            raise WarehouseError("the cluster has no node with a free core: add one by `ray start --address HOST:PORT`")
        for node, processor in processors.items():
            if processor != here.processor:
                tell(
                    f"node {node} has another processor ({processor}, here {here.processor}): figures may differ "
                    "in the last digits, and so, in the long run, may episodes"
                )
        tell(f"{counted(len(processors), 'node')} with {counted(int(ray.cluster_resources()['CPU']), 'core')}")
        yield ray


@contextlib.contextmanager
def connected(address: str, cores: int | None = None) -> Iterator[Any]:
    """Connect this process to a cluster; yields the library. Raises WarehouseError in one sentence if it cannot.

    A cluster of this machine alone ends with the context; its token and its files stay out of the user's home. Where
    this process is connected already, that connection is used, and stays.
    """
    if "ray" in sys.modules and (ray := sys.modules["ray"]).is_initialized():
        yield ray
        return
    _check_there(address)
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # else it warns of what a later version will do
    with contextlib.ExitStack() as stack:
        options: dict[str, Any] = {"address": address}
        usual = tempfile.gettempdir()
        folder = tempfile.mkdtemp(prefix="warehouse-", dir=usual if len(usual) <= _LONGEST_FOLDER else "/tmp")
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        if address == LOCAL:
            if "RAY_AUTH_MODE" not in os.environ:  # for good: Ray reads the token once in a process
                os.environ.update(RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=secrets.token_hex(32))
            options = {"address": LOCAL, "num_cpus": cores, "include_dashboard": False, "_temp_dir": folder}
        import ray

        before = signal.getsignal(signal.SIGTERM)
        try:
            with contextlib.chdir(folder):  # Ray has workers look for modules here first: nowhere is best
                ray.init(log_to_driver=False, configure_logging=False, **options)
        except (OSError, RuntimeError, ValueError) as error:  # ConnectionError is an OSError
            joins = "; this machine must belong to the cluster: `ray start --address HOST:PORT` has it join one"
            raise WarehouseError(f"--ray {address}: {_first_line(error)}{joins * (address != LOCAL)}") from None
        stack.callback(ray.shutdown)
        if before is not None:
            with contextlib.suppress(ValueError):  # not in the main thread
                signal.signal(signal.SIGTERM, before)  # else Ray's own would end this process before rows are closed
        yield ray


def _check_there(address: str) -> None:
    """Raise WarehouseError where nobody answers at HOST:PORT, which Ray itself finds out in minutes."""
    if address in (AUTO, LOCAL):
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


def _on_each_node(ray: Any, here: Node, prepare: Callable[[], None] | None) -> dict[str, str]:
    """Check and prepare all nodes; return address -> processor. WarehouseError names a node that cannot work."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    sent = {}
    for node in ray.nodes():
        if node["Alive"] and node["Resources"].get("CPU", 0) >= 1:
            on = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
            task = ray.remote(_prepared).options(num_cpus=0, scheduling_strategy=on)
            sent[f"{node['NodeManagerAddress']} ({node['NodeID'][:6]})"] = task.remote(here, prepare)
    processors = {}
    for node, reference in sent.items():
        try:
            processors[node] = ray.get(reference)
        except ray.exceptions.RayTaskError as error:
            raise WarehouseError(
                f"node {node} cannot do the jobs: {_first_line(error.cause)}; install the same version there"
            ) from None
        except ray.exceptions.RayError:
            continue  # the node is gone
    return processors


def _prepared(here: Node, prepare: Callable[[], None] | None) -> str:
    """Check and prepare the node that this runs on; return its kind of processor."""
    there = about_this_node()
    check_node(here, there)
    if prepare is not None:
        prepare()
    return there.processor


def _work(job: Job, files: JobFiles, typed: list[Typed], here: Node) -> Result:
    """Do a job on a node, on one thread, with the files that came with it."""
    from warehouse_env.threads import set_num_threads

    set_num_threads(1)
    check_node(here, about_this_node())  # the node may be new
    with unpacked(files):
        take_in(typed)
        return job.run(lambda part: None)
