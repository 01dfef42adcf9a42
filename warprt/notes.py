"""What was left out, or not understood: a line for each kind, however often it happened."""

import warnings

MOST_KINDS = 40
"""Lines at most: a file may make up as many kinds as it likes."""


class _Kind:
    """What notes of one kind have said."""

    def __init__(self, first: str):
        self.first, self.subjects, self.count = first, set(), 0


class Notes:
    """Gathers notes while something is read, to warn about them in the end."""

    def __init__(self):
        self._kinds: dict[str, _Kind] = {}

    def add(self, template: str, subject: str = "", count: int | None = None) -> None:
        """Notes the line that `template` is with the subject in place of {}, once for each subject.

        Lines of one template are of one kind. count: how many things the subject is the first of, each time.
        """
        kind = self._kinds.get(template)
        if kind is None:
            kind = self._kinds[template] = _Kind(subject)
        if count is not None or subject not in kind.subjects:
            kind.subjects.add(subject)
            kind.count += 1 if count is None else count

    def lines(self) -> list[str]:
        """A line for each kind, which names the first subject and says how many more there are."""
        found = []
        for template, kind in self._kinds.items():
            line = " ".join(template.replace("{}", kind.first, 1).split())
            found.append(line if kind.count == 1 else f"{line} (and {kind.count - 1:,} more)")
        if len(found) > MOST_KINDS:
            found[MOST_KINDS:] = [f"{len(found) - MOST_KINDS:,} more kinds of things are left out or not understood"]
        return found

    def warn(self, owner: str, stacklevel: int) -> None:
        """Warns of each line, with its owner before it."""
        for line in self.lines():
            warnings.warn(f"{owner}: {line}", stacklevel=stacklevel + 1)
