"""The daemon's telemetry, awaited.

Owns: the waiting. Must not know: what subscribing is (`telemetry.py`), requests, leases.
"""

from __future__ import annotations

from collections.abc import AsyncIterator

import zmq.asyncio

from etd.client.telemetry import Item, Subscription, deadline, left_ms


class AsyncTelemetry(Subscription[zmq.asyncio.Socket]):
    """As `Telemetry`, for asyncio: `async with`, `async for`."""

    async def __aenter__(self) -> AsyncTelemetry:
        """Returns when the subscription stands. Raises: DaemonGone if it does not come to."""
        self._joined(await self.receive(self._join_s))
        return self

    async def __aexit__(self, *_: object) -> None:
        self.close()

    async def __aiter__(self) -> AsyncIterator[Item]:
        while True:
            item = await self.receive(self._timeout_s)
            if item is None:
                raise self._silent()
            yield item

    async def receive(self, timeout_s: float | None = 0.0) -> Item | None:
        """The next (topic, report), or None if there is none within `timeout_s` (None: wait).
        Raises: Refused (`bad_message`), for more than a week.
        """
        if (first := self._take_first()) is not None:
            return first
        deadline_ns = deadline(timeout_s)
        while await self._socket.poll(left_ms(deadline_ns)):
            item = self._decoded(await self._socket.recv_multipart())
            if item is not None:
                return item
        return None
