"""Jobs done by workers that can be lost: sent off, collected, sent again. `Processes` and `Cluster` say how."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from typing import Any

from train.evaluation.jobs import Job, Numbered, Progress, Result
from warehouse_env.errors import LostError

WAIT = 0.2  # [s] between two looks at the workers


class RemoteWorkers(ABC):
    """Workers outside this process. A job whose worker is lost is sent again; what is lost each time is named."""

    tries: int  # of a job before it is given up
    again_alone = False  # whether a job is sent again only when no other one is under way
    sent_again = 0  # jobs

    @property
    @abstractmethod
    def width(self) -> int:
        """How many jobs run at a time."""

    @property
    def room(self) -> int:
        """How many jobs may be under way, queued ones included."""
        return self.width

    @abstractmethod
    def send(self, job: Job) -> Any:
        """Begin a job; return a handle by which `ended` names it."""

    @abstractmethod
    def ended(self) -> Iterator[tuple[Any, Result | None]]:
        """Yield handle and result of each job that ended within WAIT; None if its worker was lost.

        Errors of a job are raised as they are.
        """

    @abstractmethod
    def close(self) -> None:
        """Stop all workers, whatever they are doing."""

    def each(self, jobs: Sequence[Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
        """Yield number and result of each job as it ends; after all, LostError names the jobs that were lost."""
        waiting, under_way = deque(jobs), dict[Any, Numbered]()
        tried, lost, done, title = Counter[int](), list[Job](), 0.0, "workers start"
        while waiting or under_way:
            while waiting and len(under_way) < self.room:
                if self.again_alone and under_way and tried[waiting[0][0]]:
                    break
                number, job = waiting.popleft()
                tried[number] += 1
                under_way[self.send(job)] = number, job
            for handle, result in self.ended():
                number, job = under_way.pop(handle)
                if result is not None:
                    done, title = done + job.size, job.title
                    yield number, result
                elif tried[number] < self.tries:
                    self.sent_again += 1
                    waiting.append((number, job))
                else:
                    lost.append(job)
            troubles = ((self.sent_again, "sent again"), (len(lost), "lost"))
            text = "".join(f", {count} {what}" for count, what in troubles if count)
            moved(done, f"{self.width} at a time{text} · {title}")
        if lost:
            named = "; ".join(job.title for job in lost)
            raise LostError(f"{len(lost)} of {len(jobs)} jobs lost their worker {self.tries} times: {named}")
