"""Jobs done on the nodes of a Ray cluster: as tasks without side effects, sent again where a worker or a node is lost.

This process alone writes; what a job reads travels with it, so nodes need the same program and nothing else.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import signal
import socket
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from train.evaluation.jobs import WAIT, Job, Numbered, Progress, Result
from train.evaluation.nodes import Node, about_this_node, check_nodes
from train.job_files import JobFiles, pack, unpacked
from train.own import Typed, take_in, taken_in
from train.reporting.report import counted, tell
from warehouse_env.errors import LostError, WarehouseError

AUTO, LOCAL = "auto", "local"
TRIES = 4  # of a job, before it is given up
_AHEAD = 2  # jobs sent for each core, so that none waits for the next one
_KNOCK = 10.0  # [s] for a connection
_ROOM = 20  # letters that the name of a folder for temporary files may have


class Cluster:
    """The cores of a cluster; connected to when they are needed, for the first time or again."""

    def __init__(self, address: str, prepare: Callable[[], None] | None = None, cores: int | None = None) -> None:
        """Take a cluster: LOCAL, one of this machine alone; AUTO, the one that this machine belongs to; or HOST:PORT.

        prepare: called once on each node before any job, as to compile kernels. cores: of LOCAL; all if left out.
        """
        self.address, self._prepare, self._cores = address, prepare, cores
        self._opened = contextlib.ExitStack()
        self._ray: Any = None
        self._task: Any = None
        self._files: dict[tuple[str, ...], Any] = {}
        self._flying: dict[Any, Numbered] = {}
        self._again = 0

    @property
    def width(self) -> int:
        """Cores of all nodes that are there now, at least 1."""
        return max(1, int(self._connected().cluster_resources().get("CPU", 0)))

    def close(self) -> None:
        """Cancel what is under way and leave the cluster; one of this machine alone ends, and leaves nothing behind."""
        for reference in self._flying:
            self._ray.cancel(reference, force=True)
        self._flying.clear()
        self._files.clear()
        self._opened.close()
        self._ray = None
        if self._again:
            tell(f"{self._again} times a job was sent again, for its worker or node was lost")
            self._again = 0

    def each(self, jobs: Sequence[Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
        """Yield number and result of each job as it ends; after all, LostError names those that were lost each time."""
        ray, waiting, tried, lost = self._connected(), deque(jobs), Counter[int](), list[Job]()
        done, title = 0.0, ""
        while waiting or self._flying:
            cores = int(ray.cluster_resources().get("CPU", 0))
            while waiting and len(self._flying) < _AHEAD * cores:
                number, job = waiting.popleft()
                tried[number] += 1
                self._flying[self._send(job)] = number, job
            for reference in self._ended():
                number, job = self._flying.pop(reference)
                result = self._take(reference)
                if result is not None:
                    done, title = done + job.size, job.title
                    yield number, _without_times(job, result)
                elif tried[number] < TRIES:
                    self._again += 1
                    waiting.append((number, job))
                else:
                    lost.append(job)
            moved(done, f"{counted(cores, 'core')}{self._troubles(len(lost))} · {title or 'workers begin'}")
        if lost:
            named = "; ".join(job.title for job in lost)
            raise LostError(f"{len(lost)} of {len(jobs)} jobs were lost with their worker {TRIES} times: {named}")

    def _ended(self) -> Sequence[Any]:
        """Return the references to jobs that are over, after a short while at most."""
        if not self._flying:
            time.sleep(WAIT)  # for a node
            return ()
        self._ray.wait(list(self._flying), timeout=WAIT, fetch_local=False)
        ended: Sequence[Any] = self._ray.wait(list(self._flying), num_returns=len(self._flying), timeout=0.0)[0]
        return ended

    def _troubles(self, lost: int) -> str:
        return "".join(f", {count} {what}" for count, what in ((self._again, "sent again"), (lost, "lost")) if count)

    def _send(self, job: Job) -> Any:
        """Return the reference to a job's result."""
        if job.files not in self._files:
            self._files[job.files] = self._ray.put(pack(job.files))
        return self._task.remote(job, self._files[job.files], taken_in(), about_this_node().source)

    def _take(self, reference: Any) -> Result | None:
        """Return a result, None if its worker or node was lost; errors of the job are raised as they are."""
        try:
            result: Result = self._ray.get(reference)
        except self._ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except self._ray.exceptions.RayError:
            return None
        return result

    def _connected(self) -> Any:
        """Return the library, connected and with all nodes checked."""
        if self._ray is None:
            ray = self._opened.enter_context(joined(self.address, self._prepare, self._cores))
            self._task = ray.remote(_work).options(num_cpus=1, max_retries=0)
            self._ray = ray
        return self._ray


def streams(
    ray: Any, task: Callable[..., Iterator[Any]], cores: int, names: Sequence[str],
    begin: Callable[[int], tuple[Any, ...]],
) -> Iterator[tuple[int, Any]]:  # fmt: skip
    """Run a generator for each name side by side, on some cores of one node; yield number and value of all they give.

    begin: returns the arguments of a generator by its number; asked again where its worker or node was lost. After all
    others LostError names those that were lost TRIES times without giving anything between. WarehouseError where no
    node has so many cores.
    """
    most = max((node["Resources"].get("CPU", 0) for node in ray.nodes() if node["Alive"]), default=0)
    if most < cores:
        raise WarehouseError(f"no node of the cluster has {counted(cores, 'core')}, the most is {most:.0f}")
    remote = ray.remote(task).options(num_cpus=cores, max_retries=0, num_returns="streaming")
    running = {remote.remote(*begin(number)): number for number in range(len(names))}
    tried, lost = Counter[int](), list[str]()
    try:
        while running:
            for stream in ray.wait(list(running), timeout=WAIT)[0]:
                number = running[stream]
                try:
                    value = ray.get(next(stream))
                except StopIteration:
                    del running[stream]
                    continue
                except ray.exceptions.RayTaskError as error:
                    raise error.cause from None
                except ray.exceptions.RayError:
                    del running[stream]
                    tried[number] += 1
                    if tried[number] < TRIES:
                        running[remote.remote(*begin(number))] = number
                    else:
                        lost.append(names[number])
                    continue
                tried[number] = 0
                yield number, value
    finally:
        for stream in running:
            ray.cancel(stream, force=True)
    if lost:
        raise LostError(f"{', '.join(lost)} lost their worker {TRIES} times without coming forward")


@contextlib.contextmanager
def joined(address: str, prepare: Callable[[], None] | None = None, cores: int | None = None) -> Iterator[Any]:
    """Be connected to a cluster all of whose nodes have this program and are prepared; yields the library.

    The arguments are those of Cluster. WarehouseError names a node that has other code.
    """
    with connected(address, cores) as ray:
        here = about_this_node()
        nodes = _ask(ray, here)
        for note in check_nodes(here, nodes):
            tell(note)
        cores = int(ray.cluster_resources().get("CPU", 0))
        tell(f"{counted(len(nodes), 'node')} with {counted(cores, 'core')}")
        if prepare is not None:
            _on_each(ray, prepare)
        yield ray


@contextlib.contextmanager
def connected(address: str, cores: int | None = None) -> Iterator[Any]:
    """Connect this process to a cluster; yields the library. Raises WarehouseError in one sentence if it cannot.

    A cluster of this machine alone ends with the context; its token and its files stay out of the user's home.
    """
    _check_there(address)
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # else it warns of what a later version will do
    with contextlib.ExitStack() as stack:
        options: dict[str, Any] = {"address": address}
        folder = tempfile.mkdtemp(prefix="warehouse-", dir=_short_folder())
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
        socket.create_connection((host.strip("[]"), int(port)), timeout=_KNOCK).close()
    except (OSError, OverflowError) as error:
        raise WarehouseError(
            f"--ray {address}: nobody answers there ({error}); `ray start --head --port {port}` there begins a cluster"
        ) from None


def _short_folder() -> str:
    """Return a folder for temporary files whose name leaves room for sockets, which may have 107 letters."""
    usual = tempfile.gettempdir()
    return usual if len(usual) <= _ROOM else "/tmp"


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")


def _nodes(ray: Any) -> dict[str, str]:
    """Return identity -> address of the nodes that can do jobs."""
    alive = (node for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU", 0) >= 1)
    return {node["NodeID"]: node["NodeManagerAddress"] for node in alive}


def _on_each(ray: Any, call: Callable[[], Any]) -> dict[str, Any]:
    """Return what `call` gives on each node, by its address; WarehouseError names one that cannot do it."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    sent = {}
    for node, address in _nodes(ray).items():
        on = NodeAffinitySchedulingStrategy(node, soft=False)
        sent[node] = address, ray.remote(_called).options(num_cpus=0, scheduling_strategy=on).remote(call)
    given = {}
    for node, (address, reference) in sent.items():
        try:
            given[f"{address} ({node[:6]})"] = ray.get(reference)
        except ray.exceptions.RayTaskError as error:
            raise WarehouseError(
                f"node {address} cannot run this program: {_first_line(error.cause)}; install the same version there"
            ) from None
        except ray.exceptions.RayError:
            continue  # it is gone
    return given


def _called(call: Callable[[], Any]) -> Any:
    return call()


def _ask(ray: Any, here: Node) -> dict[str, Node]:
    nodes = _on_each(ray, about_this_node)
    if not nodes:
        raise WarehouseError("the cluster has no node with a free core: add one by `ray start --address HOST:PORT`")
    return nodes


def _without_times(job: Job, result: Result) -> Result:
    """Return a result without the times that were taken on a machine that does other work as well."""
    return result._replace(rows=[row | {name: None for name in job.times if name in row} for row in result.rows])


def _work(job: Job, files: JobFiles, typed: list[Typed], source: str) -> Result:
    """Do a job on a node: on one thread, with the files that came with it."""
    from warehouse_env.threads import set_num_threads

    set_num_threads(1)
    here = about_this_node()
    if here.source != source:  # a node that came later
        raise WarehouseError(f"a new node of the cluster has sources {here.source}, here they are {source}")
    with unpacked(files):
        take_in(typed)
        return job.run(lambda part: None)
