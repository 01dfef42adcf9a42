"""A bar for long work."""

import importlib.util
import sys


def bar_type() -> type:
    """The bar of tqdm that can be shown here."""
    if "ipykernel" in sys.modules and importlib.util.find_spec("ipywidgets") is not None:
        from tqdm.auto import tqdm
    else:
        from tqdm import tqdm
    return tqdm


class Bar:
    """A bar on a terminal and in a notebook, nothing elsewhere."""

    def __init__(self, title: str, total: int, unit: str = "ray"):
        self.first = 0
        """What was done before the present part."""
        options = {"desc": title, "total": total, "unit": unit, "unit_scale": True, "leave": False}
        # A notebook is no terminal, and without widgets the bar is text there.
        self._bar = bar_type()(**options, disable=False if "ipykernel" in sys.modules else None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._bar.close()

    def __call__(self, done: int, _total: int = 0) -> None:
        """`done` is that of the present part."""
        self._bar.update(self.first + done - self._bar.n)
