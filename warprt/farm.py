"""Tiles handed to workers, a few at a time, again if a worker is lost, and their results taken as they come."""

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from . import place
from .parcel import Parcel, Recipe, lock, parcel_of
from .pool import WorkerPool
from .scratch import scratch_folder
from .summary import Summary
from .tiles import Arrays, PictureTile, RayTile

if TYPE_CHECKING:
    from .tracer import Tracer

Tile = PictureTile | RayTile
TRIES = 4
"""Of a tile: so often may a worker be lost under it, or fail in a way that is not the tile's fault."""
IN_FLIGHT = 2
"""Tiles for each worker: one at work, one waiting, so that results never pile up."""
PATIENCE = 30.0
"""Seconds without a result after which it is asked whether there are workers still."""
NOTICE_S = 1.0
"""Seconds that an executor has to notice that a process of its own has died."""
OUR_FAULT = (ValueError, TypeError, ImportError, MemoryError)
"""Errors that another try would only repeat."""


class TileError(OSError):
    """A tile failed on every try, or no worker is left."""


@dataclass(frozen=True)
class Done:
    """What a worker sends back."""

    arrays: Arrays
    worker: str
    seconds: float
    is_new: bool
    """Whether the worker had to unpack the scene for it."""


class InProcess(Executor):
    """Does the work at once, here."""

    def submit(self, function, /, *arguments, **options) -> Future:
        """A future that is done."""
        future: Future = Future()
        try:
            future.set_result(function(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future


def run_tile(parcel: Parcel, tile: Tile) -> Done:
    """One tile, in a worker. Its result depends on the recipe and the tile alone."""
    with lock:
        tracer, is_new = parcel.tracer()
        started = time.perf_counter()
        try:
            arrays = tile.run(tracer)
        except OUR_FAULT:
            raise
        except Exception as error:
            if parcel.ready is None and place.is_spawned():
                _end_if_broken(tracer, error)
            raise
        return Done(arrays, place.name(), time.perf_counter() - started, is_new)


def _end_if_broken(tracer: "Tracer", error: Exception) -> None:
    """Some errors of CUDA stay with a process, which would fail every further tile: it makes way for another."""
    if not place.is_sound(tracer.device):
        print(f"warprt: worker {place.name()} ends, its device is lost: {_said(error)}", file=sys.stderr, flush=True)
        os._exit(1)


def work(
    executor: Executor,
    recipe: Recipe,
    tiles: Iterable[Tile],
    put: Callable[[Tile, Arrays], None],
    progress: Callable[[int], None] | None = None,
    tracer: "Tracer | None" = None,
) -> Summary:
    """Does all tiles; put(tile, arrays) takes each result, in whatever order they come. progress(rays done).

    tracer: one of that recipe, for tiles that are done within this process. Raises ValueError for an executor of
    forked processes and for what a tile itself raises, TileError for a tile that failed on every try, and what `put`
    raises; what was put stays put. When it is interrupted, it puts what has come meanwhile.
    """
    require_executor(executor)
    summary, started = Summary(), time.perf_counter()
    with _delivered(executor, parcel_of(recipe, tracer.budget if tracer else 1 << 30), recipe, tracer) as delivery:
        flights = _Flights(delivery, iter(tiles), summary)
        try:
            for tile, done in flights:
                put(tile, done.arrays)
                summary.add(tile.rays, done.worker, done.seconds, done.is_new)
                if progress is not None:
                    progress(summary.rays)
        except KeyboardInterrupt:
            for tile, done in flights.landed():
                put(tile, done.arrays)
            raise
        finally:
            flights.cancel()
    summary.seconds = time.perf_counter() - started
    return summary


class _Flights:
    """Tiles on their way. Going through it gives (tile, what came back)."""

    def __init__(self, delivery, tiles, summary: Summary):
        self._delivery = delivery
        self._tiles = tiles
        self._summary = summary
        self._flying: dict[Future, tuple[Tile, int]] = {}

    def __iter__(self):
        self._fill()
        while self._flying:
            landed, _ = wait(self._flying, PATIENCE, FIRST_COMPLETED)
            if not landed:
                self._delivery.require_workers()
            while landed:
                future = landed.pop()
                tile, tries = self._flying.pop(future)
                done = self._result(future, tile, tries)
                self._fill()
                if done is not None:
                    yield tile, done

    def _fill(self) -> None:
        while len(self._flying) < self._delivery.in_flight():
            tile = next(self._tiles, None)
            if tile is None:
                return
            self._submit(tile, 1)

    def _submit(self, tile: Tile, tries: int) -> None:
        self._flying[self._delivery.submit(tile)] = tile, tries

    def _result(self, future: Future, tile: Tile, tries: int) -> Done | None:
        """What came back; None if the tile had to be handed out again."""
        try:
            return future.result()
        except OUR_FAULT:
            raise
        except (Exception, CancelledError) as error:
            if tries == TRIES or self._delivery.is_final(error):
                rows = f"rows {tile.first} .. {tile.first + tile.count - 1}"
                raise TileError(f"{rows} failed{f' {tries} times' * (tries > 1)}: {_said(error)}") from error
            self._delivery.mend(error)
            self._summary.retries += 1
            self._submit(tile, tries + 1)
            return None

    def landed(self) -> Iterator[tuple[Tile, Done]]:
        """What has come back and was not asked for yet."""
        for future, (tile, _) in self._flying.items():
            if future.done() and not future.cancelled() and future.exception() is None:
                yield tile, future.result()

    def cancel(self) -> None:
        """Gives up what is not done."""
        running = [future for future in self._flying if not future.cancel()]
        if self._delivery.borrows:
            # Its owner may move things as soon as the call is over.
            wait(running)


class _Here:
    """Tiles for an executor that runs them in this process, or whose processes read files of this machine."""

    def __init__(self, executor: Executor, parcel: Parcel):
        self._executor = executor
        self._parcel = parcel
        self.borrows = parcel.ready is not None and not isinstance(executor, (ProcessPoolExecutor, WorkerPool))
        """Whether tiles may be at work with the tracer of the caller."""

    def in_flight(self) -> int:
        if isinstance(self._executor, InProcess):
            return 1
        return IN_FLIGHT * getattr(self._executor, "_max_workers", os.cpu_count())

    def require_workers(self) -> None:
        """Raises TileError when the executor waits without end; one of an unknown kind is trusted."""
        lost = _release_if_stuck(self._executor)
        if lost is not None:
            raise TileError(
                f"process {lost} of the {type(self._executor).__name__} has died, and it waits for that without end: "
                "warprt.WorkerPool mends itself"
            )

    def is_final(self, error: BaseException) -> bool:
        return False

    def submit(self, tile: Tile) -> Future:
        try:
            return self._executor.submit(run_tile, self._parcel, tile)
        except BrokenExecutor as error:
            raise TileError(f"the executor is broken, {_said(error)}: warprt.WorkerPool mends itself") from error

    def mend(self, error: BaseException) -> None:
        """Nothing that is ours to mend."""


def _release_if_stuck(executor: Executor) -> int | None:
    """Breaks a `ProcessPoolExecutor` that has lost a process without noticing, and returns the id of that process.

    It then reads half a result, or its processes wait for a lock that nobody gives back: neither the call, nor its
    `with` statement, nor Python would end.
    """
    if not isinstance(executor, ProcessPoolExecutor):
        return None
    dead = _dead_processes(executor)
    if dead:
        time.sleep(NOTICE_S)  # it notices most of them at once, and says so in its futures
    stuck = dead & _dead_processes(executor)
    if not stuck:
        return None
    with suppress(AttributeError, OSError):  # of what other versions of Python have not, or has ended meanwhile
        for process in list(executor._processes.values()):
            process.kill()
        # Pipes are open at both ends in this process too, so that neither who reads nor who writes would hear of it.
        executor._call_queue.cancel_join_thread()
        executor._result_queue._writer.close()
    return min(stuck)


def _dead_processes(executor: ProcessPoolExecutor) -> set[int]:
    """Ids of those that it believes to be alive."""
    processes = list((executor._processes or {}).values())
    return {process.pid for process in processes if process.exitcode is not None}


@contextmanager
def _delivered(executor: Executor, parcel: Parcel, recipe: Recipe, tracer: "Tracer | None"):
    """Brings the recipe to where the executor's workers find it."""
    if type(executor).__module__.startswith("distributed."):
        from .cluster import DaskDelivery

        yield DaskDelivery(executor, parcel, recipe)
        return
    parcel = replace(parcel, ready=tracer)
    if isinstance(executor, (ThreadPoolExecutor, InProcess)) and tracer is not None:
        yield _Here(executor, parcel)
        return
    with scratch_folder() as folder:
        try:
            yield _Here(executor, parcel.in_file(folder / "scene", recipe))
        finally:
            _release_if_stuck(executor)


def require_executor(executor: Executor) -> None:
    """Raises ValueError for what is none, and for one that forks its processes, in which CUDA does not work."""
    if not (hasattr(executor, "submit") and callable(executor.submit)):
        raise ValueError(f"executor must be a concurrent.futures.Executor; got {type(executor).__name__}")
    if isinstance(executor, ProcessPoolExecutor) and executor._mp_context.get_start_method() == "fork":
        raise ValueError(
            "executor forks its processes, which CUDA does not survive: use warprt.WorkerPool(), or "
            "ProcessPoolExecutor(mp_context=multiprocessing.get_context('spawn'))"
        )


def _said(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(": ")
