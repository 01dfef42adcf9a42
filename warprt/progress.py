"""A bar for long work."""


class Bar:
    """A bar on a terminal and in a notebook, nothing elsewhere."""

    def __init__(self, title: str, total: int, unit: str = "ray"):
        from tqdm.auto import tqdm

        self.first = 0
        """What was done before the present part."""
        self._bar = tqdm(desc=title, total=total, unit=unit, unit_scale=True, disable=None, leave=False)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._bar.close()

    def __call__(self, done: int, _total: int = 0) -> None:
        """`done` is that of the present part."""
        self._bar.update(self.first + done - self._bar.n)
