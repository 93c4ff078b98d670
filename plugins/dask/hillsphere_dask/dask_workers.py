"""Workers of a dask cluster seen from the campaign: hired, given work, and missed when they die.

Every task is pinned to one worker, so that it is known which task a lost worker was at; dask's own
retries never come into play. Only functions of the standard library and bytes pass through the
scheduler, which therefore needs no installation of this package: an errand is unpickled on its
worker, and what it becomes is called there.
"""

from __future__ import annotations

import asyncio
import operator
import os
import pickle
import queue
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import metadata
from itertools import count
from typing import TYPE_CHECKING, Any

from hillsphere.base.environment import environment, package_versions
from hillsphere.cases.executors.sending import pickle_work
from hillsphere.cases.executors.worker import MOST_FAULTS, format_error, is_passing
from hillsphere.interfaces.tasks import Failed, Finished, Job, Work, unready
from hillsphere.plugins import ENTRY_POINT_GROUP
from hillsphere.runs.stage_cache import source_digest

if TYPE_CHECKING:
    from distributed import Client, Future

__all__ = [
    "Answered",
    "Broken",
    "Gone",
    "Hired",
    "Member",
    "Refused",
    "Registry",
    "WorkerCount",
    "differences",
    "surroundings",
]

LOOK_S = 0.25
"""How often the scheduler is asked which workers there are."""

ANSWER_S = 15.0
"""The scheduler is taken for gone if it does not answer for so long."""

STOP_S = 30.0
"""The nanny of a worker that is to be stopped is given so long."""


@dataclass(eq=False)
class Member:
    """One worker process.

    Parameters
    ----------
    address : str
        Where it listens.
    home : str
        Its directory, which another process at the same address does not share.
    nanny : str or None
        Address of the process that restarts it.
    """

    address: str
    home: str
    nanny: str | None
    todo: asyncio.Queue[Job] = field(default_factory=asyncio.Queue)
    job: asyncio.Task[None] | None = None
    overran: bool = False


@dataclass(frozen=True)
class WorkerCount:
    """There are so many workers at first."""

    count: int


@dataclass(frozen=True)
class Hired:
    """A worker holds the work and is free."""

    member: Member


@dataclass(frozen=True)
class Refused:
    """A worker cannot be used; `why` says what is different there."""

    member: Member
    why: str


@dataclass(frozen=True)
class Gone:
    """A worker died or was stopped."""

    member: Member
    detail: str


@dataclass(frozen=True)
class Answered:
    """A worker has ended a task and is free."""

    member: Member
    outcome: Finished | Failed


@dataclass(frozen=True)
class Broken:
    """The connection to the scheduler is lost."""

    detail: str


News = WorkerCount | Hired | Refused | Gone | Answered | Broken


class Registry:
    """The workers of a cluster; runs in the event loop of the client.

    Parameters
    ----------
    client : distributed.Client
        Connected.
    work : Work
        What every worker is given once.
    at_most : int or None
        Workers that are hired at the same time.
    news : queue.SimpleQueue
        Where everything that happens is told to the campaign's thread.
    """

    def __init__(
        self, client: Client, work: Work, at_most: int | None, news: queue.SimpleQueue[News]
    ) -> None:
        self._client = client
        self._scheduler: Any = client.scheduler
        self._work = pickle_work(work)
        self._at_most = at_most
        self._news = news
        self._members: dict[str, Member] = {}
        self._refused: set[tuple[str, str]] = set()
        self._mark = f"hillsphere-{uuid.uuid4().hex[:12]}"
        self._numbers = count()
        self._stops: set[asyncio.Task[Any]] = set()
        self._here = surroundings()

    async def watch(self) -> None:
        """Hire workers as they appear and tell which ones go, until cancelled."""
        try:
            self._compare(await self._workers())
            self._news.put(WorkerCount(len(self._members)))
            while True:
                await asyncio.sleep(LOOK_S)
                self._compare(await self._workers())
        # Whatever keeps the scheduler from answering, the campaign must hear of it.
        except Exception as error:
            self._news.put(Broken(f"{type(error).__name__}: {error}" if str(error) else ""))
        finally:
            for member in self._members.values():
                if member.job is not None:
                    member.job.cancel()

    async def _workers(self) -> Mapping[str, Mapping[str, Any]]:
        """Return what the scheduler knows of its workers, by address."""
        asked = asyncio.ensure_future(self._scheduler.identity())
        try:
            for _ in range(int(ANSWER_S / LOOK_S)):
                done, _pending = await asyncio.wait({asked}, timeout=LOOK_S)
                # A client that lost its scheduler has lost its futures, even if it comes back.
                if self._client.status != "running":
                    raise ConnectionError("connection lost")
                if done:
                    workers: Mapping[str, Mapping[str, Any]] = asked.result()["workers"]
                    return workers
            raise TimeoutError(f"no answer for {ANSWER_S:.0f} s")
        finally:
            asked.cancel()

    def _compare(self, workers: Mapping[str, Mapping[str, Any]]) -> None:
        """Bring the members up to date with the workers that there are."""
        for address, member in list(self._members.items()):
            if address not in workers or workers[address]["local_directory"] != member.home:
                self._drop(member, "its process ended")
        for address, facts in workers.items():
            home = str(facts["local_directory"])
            if address in self._members or (address, home) in self._refused:
                continue
            if self._at_most is not None and len(self._members) >= self._at_most:
                break
            member = Member(address, home, facts.get("nanny"))
            self._members[address] = member
            if (threads := facts["nthreads"]) != 1:
                self._refuse(member, f"it has {threads} threads: start it with --nthreads 1")
            else:
                member.job = asyncio.ensure_future(self._serve(member))

    def _drop(self, member: Member, detail: str) -> None:
        del self._members[member.address]
        if member.job is not None:
            member.job.cancel()
        self._news.put(Gone(member, detail))

    def _refuse(self, member: Member, why: str) -> None:
        self._refused.add((member.address, member.home))
        del self._members[member.address]
        self._news.put(Refused(member, why))

    async def _serve(self, member: Member) -> None:
        """Let a worker do one task after the other."""
        from distributed import CancelledError, KilledWorker

        try:
            if why := await self._unlike(member):
                self._refuse(member, why)
                return
            # Held here as long as the worker is a member: it stays prepared.
            prepare = operator.methodcaller("prepare")
            for _ in range(MOST_FAULTS):
                do = self._submit(member, prepare, self._submit(member, pickle.loads, self._work))
                error = await _failure(do)
                if error is None or not is_passing(error):
                    break
            broken = None if error is None else format_error(error)
            self._news.put(Hired(member))
            while True:
                task = await member.todo.get()
                if broken is not None:
                    self._news.put(Answered(member, Failed(task, *broken)))
                elif (outcome := await self._do(member, do, task)) is not None:
                    self._news.put(Answered(member, outcome))
                else:
                    return
        # The worker has died, or somebody else's restart took the task away; if it is the scheduler
        # that is gone, `watch` tells of it.
        except (CancelledError, KilledWorker) as end:
            if self._client.status == "running" and self._members.get(member.address) is member:
                self._drop(member, " ".join(str(end).split()) or type(end).__name__)

    async def _unlike(self, member: Member) -> str:
        """Return how a worker differs from this process in what matters; empty if it does not."""
        from distributed import CancelledError, KilledWorker

        try:
            there = await self._submit(
                member, operator.call, self._submit(member, pickle.loads, _SURROUNDINGS)
            )
        except (CancelledError, KilledWorker):
            raise
        # Whatever the import of the package raises there.
        except Exception as error:
            version = package_versions(("hillsphere",)).get("hillsphere", "of this version")
            return (
                f"hillsphere cannot be used there ({type(error).__name__}: {error}): install "
                f"hillsphere {version} and the mission's plugins in its environment"
            )
        return "; ".join(differences(self._here, there))

    async def _do(self, member: Member, do: Future[Any], task: Job) -> Finished | Failed | None:
        """Return what comes of a task; ``None`` if the worker is being stopped for it."""
        from distributed import CancelledError, KilledWorker

        sent = self._submit(member, pickle.loads, pickle.dumps(task))
        # What the work can make ready beforehand does not count against the task's limit.
        for _ in range(MOST_FAULTS):
            ready = self._submit(
                member, operator.call, self._submit(member, pickle.loads, _READY), do, sent
            )
            try:
                fault = await asyncio.wait_for(_failure(ready), task.ready_limit_s)
            except TimeoutError:
                self._stop_later(member)
                return Failed(task, unready(task), "")
            if fault is None or not is_passing(fault):
                break
        if fault is not None:
            return Failed(task, *format_error(fault))
        waiting = asyncio.ensure_future(_result(self._submit(member, operator.call, do, sent)))
        try:
            done, _ = await asyncio.wait({waiting}, timeout=task.limit_s)
            if not done:
                member.overran = True
                self._stop_later(member)
                return None
            return Finished(task, waiting.result())
        except (CancelledError, KilledWorker):
            raise
        # Whatever the work's function raised over there.
        except Exception as error:
            return Failed(task, *format_error(error))
        finally:
            waiting.cancel()

    def _stop_later(self, member: Member) -> None:
        stop = asyncio.ensure_future(self._stop(member))
        self._stops.add(stop)
        stop.add_done_callback(self._stops.discard)

    async def _stop(self, member: Member) -> None:
        """Have a worker's process ended by its nanny, which starts another."""
        with suppress(OSError):  # the scheduler is gone, of which `watch` tells
            await self._scheduler.restart_workers(
                workers=[member.address],
                timeout=STOP_S,
                wait_for_workers=False,
                on_error="return",
                stimulus_id=f"{self._mark}-limit",
            )

    def _submit(self, member: Member, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        key = f"{self._mark}-{next(self._numbers)}"
        return self._client.submit(
            function, *arguments, key=key, workers=[member.address], pure=False, retries=0
        )


async def _result(future: Future[Any]) -> Any:
    return await future


async def _failure(future: Future[Any]) -> BaseException | None:
    """Wait for a future whose value stays where it is; return what it raised."""
    from distributed import CancelledError

    exception: Any = future.exception  # of a client's loop, where it is to be awaited
    error: BaseException | None = await exception()
    if future.status == "cancelled":
        raise CancelledError(future.key)
    return error


def surroundings() -> dict[str, str]:
    """Return everything that a result's bits and the meaning of a mission depend on.

    Returns
    -------
    dict
        ``"python"``, ``"cpu features"``, ``"numpy"`` …: the same keys and values in every process
        that computes the same bits. Plugins are those that are installed.
    """
    facts = environment()
    facts_here = {key: str(facts[key]) for key in ("python", "system", "machine")}
    facts_here["C library"] = facts["c_library"]
    facts_here["CPU features"] = " ".join(facts["cpu_features"])
    facts_here["kernels chosen by variables"] = (
        " ".join(f"{name}={value}" for name, value in facts["kernels"].items()) or "none"
    )
    facts_here |= {name: str(version) for name, version in facts["packages"].items()}
    modules = {point.value.partition(":")[0] for point in _plugins()}
    for module in sorted(modules | {"hillsphere"}):
        try:
            source = source_digest(module)
        except (ImportError, ValueError):  # a broken plugin, which no mission can use
            continue
        if source is not None:
            facts_here[f"sources of {source[0]}"] = source[1][:16]
    # The variable that OpenBLAS heeds, then the one that it falls back to; dask's nannies set both.
    blas = os.environ.get("OPENBLAS_NUM_THREADS") or os.environ.get("OMP_NUM_THREADS")
    facts_here["threads of BLAS"] = blas or "all"
    return facts_here


def _plugins() -> metadata.EntryPoints:
    return metadata.entry_points(group=ENTRY_POINT_GROUP)


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> list[str]:
    """Return what keeps a worker from computing the same bits as this process.

    Parameters
    ----------
    here, there : mapping
        `surroundings` of this process and of the worker.

    Returns
    -------
    list of str
        What is different, and what to do. A plugin that only one of them has is none: work that
        needs it fails by itself.
    """
    lines = [
        f"{name} is {there.get(name, 'missing')} there, {value} here"
        for name, value in here.items()
        if name != "threads of BLAS"
        and there.get(name) != value
        and (name in there or not name.startswith("sources of "))
    ]
    if lines:
        lines[-1] += ": start its workers from the same environment, on the same type of processor"
    if (threads := there.get("threads of BLAS")) != "1":
        lines.append(
            f"its BLAS may use {threads} threads: start it with a nanny, or with OMP_NUM_THREADS=1"
        )
    return lines


def make_ready(do: Any, task: Job) -> None:
    """Have work make ready what it can before a task, if it knows such."""
    if hasattr(do, "ready"):
        do.ready(task)


_READY = pickle.dumps(make_ready)
_SURROUNDINGS = pickle.dumps(surroundings)
