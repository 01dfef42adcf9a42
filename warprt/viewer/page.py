"""One page that is open: what is to be sent to it, and what it says."""

import asyncio
import json
from collections.abc import Callable


class Page:
    """A live connection. `window` is what the page has said of its result window, None before."""

    def __init__(self, connection):
        self.window = None
        self._connection = connection
        self._waiting: dict[str, dict | bytes] = {}
        self._has_news = asyncio.Event()

    def tell(self, kind: str, message: dict | bytes) -> None:
        """Sends as soon as the browser takes it; a newer message of the same kind replaces one that still waits."""
        self._waiting[kind] = message
        self._has_news.set()

    async def send(self) -> None:
        """Sends what there is, for as long as the connection lasts."""
        while True:
            await self._has_news.wait()
            self._has_news.clear()
            while self._waiting:
                kind = next(iter(self._waiting))
                message = self._waiting.pop(kind)
                is_bytes = isinstance(message, bytes)
                await self._connection.send(
                    message if is_bytes else json.dumps({"type": kind, **message}, allow_nan=False)
                )

    def hear(self, text: str | bytes, on_message: Callable[["Page", dict], None]) -> None:
        """Hands on what the page says; what is no message is answered with a word on it, and does no harm."""
        try:
            message = json.loads(text)
            if not isinstance(message, dict) or not isinstance(message.get("type"), str):
                raise ValueError("a message must be an object with a type")
            on_message(self, message)
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            self.tell("error", {"text": f"{error}" or "no message"})
