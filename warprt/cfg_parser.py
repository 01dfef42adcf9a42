"""The grammar of .cfg files: from text to blocks of statements, each with its place."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import lark

from .brief import brief


@dataclass(slots=True)
class Statement:
    """key = value; with its place in the file."""

    key: str
    value: Any
    line: int
    column: int


@dataclass(slots=True)
class Block:
    """kind name { ... } with its place in the file."""

    kind: str
    name: str | None
    statements: list[Statement]
    line: int
    column: int


class Word(str):
    """A bare name, as opposed to a quoted string."""


class _Builder(lark.Transformer):
    """From the parse tree to blocks."""

    def number(self, items):
        return float(items[0].rstrip("f"))

    def boolean(self, items):
        return items[0] == "true"

    def string(self, items):
        return str(items[0][1:-1])

    def name(self, items):
        return Word(items[0])

    def tuple(self, items):
        return tuple(float(item.rstrip("f")) for item in items)

    def statement(self, items):
        key, value = items
        return Statement(str(key), value, key.line, key.column)

    def block(self, items):
        kind, name, *statements = items
        return Block(str(kind), None if name is None else str(name), statements, kind.line, kind.column)

    def start(self, items):
        return items


@cache
def _parser() -> lark.Lark:
    grammar = Path(__file__).with_name("cfg.lark").read_text(encoding="utf-8")
    return lark.Lark(grammar, parser="lalr", maybe_placeholders=True, transformer=_Builder())


def parse(text: str, path: str | Path) -> list[Block]:
    """The blocks of a file, or a ValueError `FILE:LINE:COLUMN: what`."""
    try:
        return _parser().parse(text)
    except lark.UnexpectedToken as error:
        expected = " or ".join(sorted(_READABLE.get(name, name) for name in error.expected))
        is_end = error.token.type == "$END"
        got = "the end of the file" if is_end else brief(str(error.token))
        line, column = _end_of(text) if is_end else (error.line, error.column)
        raise ValueError(f"{path}:{line}:{column}: expected {expected}; got {got}") from None
    except lark.UnexpectedCharacters as error:
        raise ValueError(f"{path}:{error.line}:{error.column}: unexpected {error.char!r}") from None


_READABLE = {
    "NAME": "a name",
    "NUMBER": "a number",
    "STRING": 'a "string"',
    "BOOLEAN": "true or false",
    "LBRACE": "'{'",
    "RBRACE": "'}'",
    "LPAR": "'('",
    "RPAR": "')'",
    "EQUAL": "'='",
    "SEMICOLON": "';'",
    "COMMA": "','",
    "$END": "the end of the file",
}


def _end_of(text: str) -> tuple[int, int]:
    return text.count("\n") + 1, len(text) - text.rfind("\n")
