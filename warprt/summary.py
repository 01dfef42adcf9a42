"""What has come of work that was shared out."""

from collections import Counter
from dataclasses import dataclass, field


@dataclass
class Summary:
    """Who did what."""

    seconds: float = 0.0
    rays: int = 0
    tiles: Counter = field(default_factory=Counter)
    """Finished tiles by worker."""
    busy: Counter = field(default_factory=Counter)
    """Seconds at work by worker."""
    scenes: Counter = field(default_factory=Counter)
    """How often a worker unpacked the scene."""
    retries: int = 0
    """Tiles that were handed out again."""

    def add(self, rays: int, worker: str, seconds: float, is_new: bool) -> None:
        """Counts a finished tile. is_new: whether the worker had to unpack the scene for it."""
        self.rays += rays
        self.tiles[worker] += 1
        self.busy[worker] += seconds
        self.scenes[worker] += is_new

    def __str__(self) -> str:
        lines = [
            f"{worker}: {count} tiles in {self.busy[worker]:.2f} s of work, scene unpacked {self.scenes[worker]} x"
            for worker, count in sorted(self.tiles.items())
        ]
        again = "1 retry" if self.retries == 1 else f"{self.retries} retries"
        return "\n".join([*lines, f"{self.tiles.total()} tiles by {len(self.tiles)} workers, {again}"])
