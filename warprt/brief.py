"""Values as errors show them: short, however large they are."""

import reprlib

MOST = 80
"""Characters."""
MOST_LISTED = 20


class _Short(reprlib.Repr):
    """Looks at no more of a value than it shows: names of megabytes, and lists in lists in lists, cost nothing."""

    def __init__(self):
        super().__init__()
        self.maxlevel, self.maxlist, self.maxtuple, self.maxdict = 4, 20, 20, 10

    def repr_str(self, value: str, _level: int) -> str:
        return repr(value) if len(value) <= MOST else f"{value[:MOST]!r}"

    def repr_int(self, value: int, _level: int) -> str:
        return repr(value) if value.bit_length() < 1000 else "a huge integer"


_SHORT = _Short()


def brief(value) -> str:
    """A value as an error shows it."""
    text = repr(value) if isinstance(value, str) and len(value) < MOST else _SHORT.repr(value)
    return text if len(text) <= MOST else f"{text[: MOST - 3]}..."


def shown(name: str) -> str:
    """A name within a sentence: as it is, unless it is long."""
    return name if len(name) <= MOST else brief(name)


def listing(names) -> str:
    """Names as an error lists them: the first few."""
    names = list(names)
    return ", ".join([*map(shown, names[:MOST_LISTED]), *["..."] * (len(names) > MOST_LISTED)]) or "none"
