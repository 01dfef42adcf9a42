"""Objects whose arrays are read-only."""

import numpy as np


class ReadOnly:
    """Base of objects whose arrays stay read-only in copies and pickles, which NumPy makes writable."""

    def __setstate__(self, state: dict):
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        self.__dict__.update(state)
