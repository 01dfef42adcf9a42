"""One page that is open: what is to be sent to it, and what it says."""

import asyncio
import json
from collections.abc import Callable


class Page:
    """A live connection."""

    def __init__(self, connection):
        self._connection = connection
        self._waiting: dict[str, str | bytes] = {}
        self._has_news = asyncio.Event()

    def tell(self, kind: str, message: dict | bytes) -> None:
        """Sends as soon as the browser takes it; a newer message of the same kind replaces one that still waits.

        Raises TypeError or ValueError for what JSON has no word for.
        """
        self.offer(kind, encoded(kind, message))

    def offer(self, kind: str, message: str | bytes) -> None:
        """The same for what is `encoded`."""
        self._waiting[kind] = message
        self._has_news.set()

    async def send(self) -> None:
        """Sends what there is, for as long as the connection lasts."""
        while True:
            await self._has_news.wait()
            self._has_news.clear()
            while self._waiting:
                kind = next(iter(self._waiting))
                await self._connection.send(self._waiting.pop(kind))

    def hear(self, text: str | bytes, on_message: Callable[["Page", dict], None]) -> None:
        """Hands on what the page says; what is no message is answered with a word on it, and does no harm."""
        try:
            message = json.loads(text)
            if not isinstance(message, dict) or not isinstance(message.get("type"), str):
                raise ValueError("a message must be an object with a type")
            on_message(self, message)
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            self.tell("error", {"text": f"{error}" or "no message"})


def encoded(kind: str, message: dict | bytes) -> str | bytes:
    """What goes over the wire: where a message makes no sense, whoever sends it hears of it, and no other thread."""
    return message if isinstance(message, bytes) else json.dumps({"type": kind, **message}, allow_nan=False)
