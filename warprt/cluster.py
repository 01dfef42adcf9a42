"""Workers of a Dask cluster."""

import importlib.util
import math
import time
import weakref
from concurrent.futures import CancelledError, Executor, Future

import warp as wp

from . import place
from ._version import __version__
from .farm import Tile, TileError, run_tile
from .parcel import Parcel, Recipe

_scattered = weakref.WeakKeyDictionary()
"""The last scene of each client, by its key: the next picture of it finds it there."""
PATIENCE = 30.0
"""Seconds to wait for a scheduler, or for a first worker."""


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
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise ConnectionError(f"no worker has come to {client.scheduler.address} within {PATIENCE:g} s") from None

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
    for worker, found in client.run(versions).items():
        for name, version in wanted.items():
            if found[name] != version:
                has = f"has {name} {found[name]}" if found[name] else f"has no {name}"
                raise ValueError(f"worker {worker} {has}, but the work is of {name} {version}")


class DaskDelivery:
    """The recipe scattered to the workers of a client: once to each, and kept there."""

    def __init__(self, executor: Executor, parcel: Parcel, recipe: Recipe):
        self._executor = executor
        self._client = executor._client
        self._parcel = parcel
        self._recipe = recipe
        self._address = self._client.scheduler.address
        self._count, self._counted_at = 1, -math.inf
        require_workers(self._client)
        key, self._scattered = _scattered.get(self._client, ("", None))
        if key != parcel.key or self._scattered.status != "finished":
            self._scatter()

    def _scatter(self) -> None:
        # To all of them, so that it is not lost with one. hash=False: a new key each time, as a lost one stays lost.
        self._scattered = self._client.scatter(self._parcel.packed(self._recipe), broadcast=True, hash=False)
        _scattered[self._client] = self._parcel.key, self._scattered

    def workers(self) -> int:
        """How many there are now, or were a second ago: asking takes a way to the scheduler and back."""
        if time.monotonic() > self._counted_at + 1 and self._client.status == "running":
            self._count = max(1, len(self._client.scheduler_info(n_workers=-1).get("workers", {})))
            self._counted_at = time.monotonic()
        return self._count

    def submit(self, tile: Tile) -> Future:
        """As the executor's own, whose futures never end when the scheduler is lost as their result is fetched."""
        try:
            # pure=False: a tile that failed is not answered from memory.
            task = self._client.submit(run_tile, self._scattered, tile, **{**self._executor._kwargs, "pure": False})
        except RuntimeError as error:
            raise TileError(f"the Dask client is closed ({error})") from None
        future: Future = Future()
        future.add_done_callback(lambda _: task.cancel() if future.cancelled() else None)
        task.add_done_callback(lambda _: _land(task, future))
        return future

    def mend(self, error: BaseException) -> None:
        """Scatters again when the scene may be lost: a cancelled tile means that its scheduler, or its input, is."""
        if not isinstance(error, CancelledError) and "Cancelled" not in type(error).__name__:
            return
        if self._scattered.status == "finished" and self._client.status == "running":
            return
        end = time.monotonic() + PATIENCE
        while self._client.status != "running":
            if time.monotonic() > end or self._client.status == "closed":
                raise TileError(f"the scheduler at {self._address} is gone")
            time.sleep(0.1)
        require_workers(self._client)
        self._scatter()


def _land(task, future: Future) -> None:
    """Passes on what has become of a task."""
    if not future.set_running_or_notify_cancel():
        return
    try:
        future.set_result(task.result(timeout=PATIENCE))
    except (Exception, CancelledError) as error:
        future.set_exception(error)
    finally:
        # Or else the worker keeps its copy until Python finds the ring of callbacks.
        task.release()


def kind(client, asked: str | None) -> str:
    """The kind of device, "cpu" or "cuda", that the work is for: as asked, or that which all workers have.

    Raises ValueError where they differ, or have not what is asked for.
    """
    kinds = client.run(place.default_kind)
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
