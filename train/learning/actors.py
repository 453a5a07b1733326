"""The workers of our own trainer as Ray actors: the same training, to the bit, on the cores of several machines.

Each actor is a process with one core, a worker and a network of its own. With each call the network goes to all actors
if it changed, about 100 kB; advantages, targets and gradients come back. Where an actor or its machine is gone, all are
given up, and the training goes on from its last checkpoint with new ones (`run_training`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from agents.networks import ActorCritic
from train.job_files import JobFiles, pack, unpacked
from train.learning.config import ThreadedConfig
from train.learning.crew import ActorLoss, Worker
from train.learning.timing import set_threads
from train.own import Typed, take_in, taken_in
from warehouse_env.errors import LostError

T = TypeVar("T")
_PATIENCE = 300.0  # [s] for Ray to find a core for every actor
_WITH_A_CALL = 100_000  # bytes that Ray sends with a call, in half the time; more goes through its store


class Actors:
    """Workers that are Ray actors (see `Crew`); this process is connected to Ray already."""

    def __init__(self, config: ThreadedConfig, actor_loss: ActorLoss) -> None:
        """Start the actors and have them make their worlds; LostError where Ray finds no core for each in time."""
        import ray

        self._ray: Any = ray
        self._weights: NDArray[np.float32] | None = None
        remote: Any = ray.remote(num_cpus=1, max_restarts=0)(_Host)
        self._actors = [remote.remote() for _ in range(config.threads)]
        try:
            self._await()
            given = config, actor_loss, pack(config.layouts), taken_in()
            self._get([actor.make.remote(number, *given) for number, actor in enumerate(self._actors)])
        except BaseException:
            self.close()
            raise

    def share(self, net: ActorCritic) -> None:
        """Have the network sent with the next piece of work (see `Crew.share`)."""
        self._weights = _vector(net)

    def each(self, work: Callable[..., T], arguments: Sequence[tuple[Any, ...]]) -> list[T]:
        """Do a piece of work, each actor its own (see `Crew.each`)."""
        sent: Any
        sent, self._weights = self._weights, None
        if sent is not None and sent.nbytes > _WITH_A_CALL:
            sent = self._ray.put(sent)
        pairs = zip(self._actors, arguments, strict=True)
        return self._get([actor.do.remote(work.__name__, sent, *given) for actor, given in pairs])

    def close(self) -> None:
        """End the actors."""
        for actor in self._actors:
            self._ray.kill(actor)

    def _get(self, references: list[Any]) -> list[Any]:
        """Return what the actors give; their own errors are raised as they are."""
        try:
            results: list[Any] = self._ray.get(references)
        except self._ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except self._ray.exceptions.RayError:
            raise LostError("a worker of the training is gone, with its process or its machine") from None
        return results

    def _await(self) -> None:
        """Wait until each actor has its core."""
        ready = [actor.ready.remote() for actor in self._actors]
        _, missing = self._ray.wait(ready, num_returns=len(ready), timeout=_PATIENCE)
        if missing:
            raise LostError(
                f"Ray found no core within {_PATIENCE:.0f} s for {len(missing)} of the {len(ready)} workers "
                f"(--threads); it has {_cores():.0f} in all"
            )
        self._get(ready)


class _Host:
    """What an actor runs: one worker, and its copy of the network."""

    def ready(self) -> None:
        """Say that the actor has begun."""

    def make(
        self, number: int, config: ThreadedConfig, actor_loss: ActorLoss, files: JobFiles, parts: list[Typed]
    ) -> None:
        """Make the worlds, with the files and the parts of one's own that the config names."""
        set_threads(1)
        with unpacked(files):
            take_in(parts)
            self._worker = Worker(config, number, actor_loss)
        network = self._worker.facts().network
        self._worker.net = ActorCritic(network, np.zeros(network.actions, np.float32))

    def do(self, work: str, weights: NDArray[np.float32] | None, *given: Any) -> Any:
        """Take over the network where it is sent, and do a piece of work."""
        if weights is not None:
            _take_over(self._worker.net, weights)
        return getattr(self._worker, work)(*given)


def _vector(net: ActorCritic) -> NDArray[np.float32]:
    """Return all parameters in their order, float32[P]."""
    return torch.nn.utils.parameters_to_vector(net.parameters()).detach().numpy()


def _take_over(net: ActorCritic, weights: NDArray[np.float32]) -> None:
    """Copy float32[P] into the network: where its tensors lie may change what a product of matrices rounds to."""
    parameters = list(net.parameters())
    pieces = torch.split(torch.tensor(weights), [parameter.numel() for parameter in parameters])
    with torch.no_grad():
        for parameter, piece in zip(parameters, pieces, strict=True):
            parameter.copy_(piece.view_as(parameter))


def _cores() -> float:
    import ray

    resources: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
    return resources.get("CPU", 0.0)
