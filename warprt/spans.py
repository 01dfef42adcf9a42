"""Which rows of many are there."""

from bisect import bisect_left, bisect_right


class Spans:
    """A set of whole numbers, kept as the runs that it consists of."""

    def __init__(self):
        self._starts: list[int] = []
        self._ends: list[int] = []
        """One past the last number of each run; runs neither overlap nor touch."""

    def add(self, first: int, count: int) -> None:
        """Adds first .. first + count - 1."""
        if count == 0:
            return
        end = first + count
        low, high = bisect_left(self._ends, first), bisect_right(self._starts, end)
        if low < high:
            first, end = min(first, self._starts[low]), max(end, self._ends[high - 1])
        self._starts[low:high], self._ends[low:high] = [first], [end]

    def covers(self, first: int, count: int) -> bool:
        """Whether all of first .. first + count - 1 are there, of which there is at least one."""
        run = bisect_right(self._starts, first) - 1
        return count > 0 and run >= 0 and first + count <= self._ends[run]

    def __len__(self) -> int:
        return sum(self._ends) - sum(self._starts)
