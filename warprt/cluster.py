"""Workers of a Dask cluster."""

import asyncio
import contextlib
import importlib.util
import math
import time
import weakref
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

import warp as wp

from . import place
from ._version import __version__
from .farm import IN_FLIGHT, Done, Tile, TileError, run_tile
from .parcel import Parcel, Recipe
from .tiles import RayTile

_scattered = weakref.WeakKeyDictionary()
"""The last scene of each client, by its key: the next picture of it finds it there."""
PATIENCE = 30.0
"""Seconds to wait for a scheduler, for a first worker, or for another one when all are gone."""
SMALL = 1 << 20
"""Bytes of rays that may go with a tile; more take the way of Dask's data."""


def connect(address: str):
    """A `distributed.Client` of the scheduler at an address such as "tcp://host:8786".

    Raises ValueError where Dask is not installed, ConnectionError when nobody answers in time.
    """
    if importlib.util.find_spec("distributed") is None:
        raise ValueError("a scheduler needs Dask: pip install 'warprt[distributed]'")
    import distributed

    try:
        return distributed.Client(address, timeout=PATIENCE)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{address!r} is no address of a Dask scheduler, such as tcp://host:8786: {error}") from None
    except OSError:
        raise ConnectionError(f"no Dask scheduler answers at {address} within {PATIENCE:g} s") from None


def require_workers(client) -> None:
    """Waits for a first worker; then raises ValueError that names a worker without warprt, or with another version.

    Raises ConnectionError when there is no worker in time.
    """

    def versions() -> dict[str, str | None]:
        # A function within a function travels by value, so it runs where warprt is missing.
        import importlib

        found = {}
        for name in ("warprt", "warp"):
            try:
                found[name] = importlib.import_module(name).__version__
            except ImportError:
                found[name] = None
        return found

    wanted = {"warprt": __version__, "warp": wp.__version__}
    for worker, found in _asked(client, versions).items():
        for name, version in wanted.items():
            if found[name] != version:
                has = f"has {name} {found[name]}" if found[name] else f"has no {name}"
                raise ValueError(f"worker {worker} {has}, but the work is of {name} {version}")


def _asked(client, question) -> dict:
    """What each worker answers; one that dies meanwhile does not count. ConnectionError if none answers in time."""

    def ask() -> dict:
        answers = client.run(question, on_error="return")
        living = {worker: answer for worker, answer in answers.items() if not isinstance(answer, Exception)}
        if not living:
            raise ConnectionError(
                f"no worker of {client.scheduler.address} answers: {next(iter(answers.values()), 'there is none')}"
            )
        return living

    return _patiently(client, ask)


def _patiently(client, step: Callable[[], Any]):
    """What step() returns, tried again while workers, or the scheduler, are lost under it, and others come.

    Raises ConnectionError when that has not helped for `PATIENCE` seconds.
    """
    address, end = client.scheduler.address, None
    while True:
        _await_workers(client, address, end or time.monotonic() + PATIENCE)
        try:
            return step()
        except (Exception, asyncio.CancelledError) as error:  # Dask has many, a bare KeyError among them
            end = end or time.monotonic() + PATIENCE
            if time.monotonic() >= end or client.status == "closed":
                said = error if isinstance(error, ConnectionError) else f"{type(error).__name__}: {error}"
                raise ConnectionError(
                    f"workers of {address} are lost again and again, for {PATIENCE:g} s: {said}"
                ) from error
        time.sleep(0.1)


def _await_workers(client, address: str, end: float) -> None:
    """Waits for the scheduler, and for a first worker. Raises ConnectionError when one is not there in time."""
    while True:
        if client.status == "closed" or (client.status != "running" and time.monotonic() > end):
            raise ConnectionError(f"the scheduler at {address} is gone")
        if client.status == "running":
            try:
                client.wait_for_workers(1, timeout=max(0.1, end - time.monotonic()))
                return
            except (TimeoutError, asyncio.TimeoutError):
                raise ConnectionError(f"no worker has come to {address} within {PATIENCE:g} s") from None
            except OSError:
                pass  # the scheduler is lost meanwhile
        time.sleep(0.1)


class DaskDelivery:
    """The recipe scattered to the workers of a client: once to each, and kept there."""

    def __init__(self, executor: Executor, parcel: Parcel, recipe: Recipe):
        self._executor = executor
        self._client = executor._client
        self._parcel = parcel
        self._recipe = recipe
        self._address = self._client.scheduler.address
        self._count, self._counted_at = 1, -math.inf
        self._resources = executor._kwargs.get("resources") or {}
        self._named = None if executor._kwargs.get("allow_other_workers") else executor._kwargs.get("workers")
        self._scattered = None
        try:
            require_workers(self._client)
            self._bring()
        except ConnectionError as error:
            raise TileError(str(error)) from error

    def _bring(self) -> None:
        """Sees to it that workers have the scene."""
        key, known = _scattered.get(self._client, ("", None))
        if key == self._parcel.key and known is not self._scattered and known.status == "finished":
            self._scattered = known
            # Dask has dropped the copies of workers that waited for work, and would give them none.
            with contextlib.suppress(Exception):  # of a worker that dies meanwhile
                replicate = self._client.scheduler.replicate
                self._client.sync(replicate, keys=[known.key], n=None, callback_timeout=PATIENCE)
        if self._scattered is None or not self._is_there():
            parcel = self._parcel.packed(self._recipe)
            self._scattered = _patiently(self._client, lambda: self._scatter(parcel))
            _scattered[self._client] = self._parcel.key, self._scattered

    def _scatter(self, parcel: Parcel):
        # To all of them, so that it is not lost with one. hash=False: a new key each time, as a lost one stays lost.
        scattered = self._client.scatter(parcel, broadcast=True, hash=False)
        if not any(self._client.who_has([scattered]).values()):
            raise ConnectionError("the scene was lost with the workers that it was sent to")
        return scattered

    def _is_there(self) -> bool:
        """Whether a worker has the scene still."""
        try:
            return self._scattered.status == "finished" and any(self._client.who_has([self._scattered]).values())
        except Exception:
            return False

    borrows = False

    def in_flight(self) -> int:
        """Tiles for the workers there are now, or were a second ago: asking takes a way to the scheduler and back."""
        if time.monotonic() > self._counted_at + 1 and self._client.status == "running":
            with contextlib.suppress(OSError):  # the scheduler is lost meanwhile
                self._count = max(1, self._eligible())
            self._counted_at = time.monotonic()
        return IN_FLIGHT * self._count

    def _eligible(self) -> int:
        """Workers that have what the work asks for, such as GPU=1, or are those that it names."""
        workers = self._client.scheduler_info(n_workers=-1).get("workers", {})
        wanted = self._resources.items()
        named = {self._named} if isinstance(self._named, str) else set(self._named or ())
        return sum(
            all(w.get("resources", {}).get(name, 0) >= count for name, count in wanted)
            and (not named or bool(named & {address, w.get("name"), w.get("host")}))
            for address, w in workers.items()
        )

    def require_workers(self) -> None:
        """Raises TileError if none has come in time, which Dask would wait for without end."""
        end = time.monotonic() + PATIENCE
        while self._client.status == "running" and not self._eligible():
            if time.monotonic() > end:
                which = " ".join(f"{name}={count:g}" for name, count in self._resources.items()) or self._named
                raise TileError(f"no worker{f' with {which}' * bool(which)} is left at {self._address}")
            time.sleep(0.1)

    def is_final(self, error: BaseException) -> bool:
        """Whether Dask has tried it on several workers, all of which died of it."""
        return type(error).__name__ == "KilledWorker"

    def submit(self, tile: Tile) -> Future:
        """As the executor's own, whose futures never end when the scheduler is lost as their result is fetched."""
        future: Future = Future()
        try:
            if isinstance(tile, RayTile) and tile.bytes > SMALL:
                tile = self._client.scatter(tile, hash=False)
            # pure=False: a tile that failed is not answered from memory.
            task = self._client.submit(run_tile, self._scattered, tile, **{**self._executor._kwargs, "pure": False})
        except (Exception, asyncio.CancelledError) as error:
            if self._client.status in ("closing", "closed"):
                raise TileError(f"the Dask client is closed ({error})") from None
            # Of workers that died, or none: tried again as if the tile had been lost with them.
            future.set_exception(error)
            return future
        future.add_done_callback(lambda _: task.cancel() if future.cancelled() else None)
        task.add_done_callback(lambda _: self._land(task, future))
        return future

    def _land(self, task, future: Future) -> None:
        """Passes on what has become of a task."""
        if not future.set_running_or_notify_cancel():
            return
        try:
            future.set_result(self._fetched(task))
        except BaseException as error:  # that of a cancelled task is no Exception in all versions
            future.set_exception(error)
        finally:
            # Or else the worker keeps its copy until Python finds the ring of callbacks.
            task.release()

    def _fetched(self, task) -> Done:
        """Its result, for which a slow network gets twice the time on each try while the scheduler is there."""
        patience = PATIENCE
        while True:
            try:
                return task.result(timeout=patience)
            except TimeoutError:
                if task.status != "finished" or self._client.status != "running":
                    raise
                patience *= 2

    def mend(self, error: BaseException) -> None:
        """Waits for workers, and brings them the scene again if it was lost with all that had it.

        Raises TileError when there are none in time.
        """
        if self._client.status == "running" and self._is_there():
            self.require_workers()
            return
        try:
            require_workers(self._client)
            self._bring()
        except ConnectionError as lost:
            raise TileError(str(lost)) from error


def kind(client, asked: str | None) -> str:
    """The kind of device, "cpu" or "cuda", that the work is for: as asked, or that which all workers have.

    Raises ValueError where they differ, or have not what is asked for.
    """
    kinds = _asked(client, place.default_kind)
    if asked is not None:
        wanted = asked.partition(":")[0]
        if wanted not in ("cpu", "cuda"):
            raise ValueError(f"device must be cpu or cuda for the workers of a cluster; got {asked!r}")
        bare = [worker for worker, found in kinds.items() if wanted == "cuda" and found != "cuda"]
        if len(bare) == len(kinds):
            raise ValueError(f"no worker has a CUDA device; there is {', '.join(bare)}")
        return wanted
    if len(set(kinds.values())) > 1:
        named = ", ".join(f"{worker} {found}" for worker, found in sorted(kinds.items()))
        raise ValueError(f"workers compute on different devices, which differ in last digits: give --device ({named})")
    return next(iter(kinds.values()))


def executor(client, kind: str) -> Executor:
    """For work of that kind: on a GPU, only workers that were started with `--resources GPU=1`, if any were."""
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    has_resource = any("GPU" in worker.get("resources", {}) for worker in workers)
    return client.get_executor(**({"resources": {"GPU": 1}} if kind == "cuda" and has_resource else {}))
