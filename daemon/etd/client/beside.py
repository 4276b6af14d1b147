"""What goes on beside the program: a presentation that was begun, and a lease that is kept.

Owns: their threads. Must not know: what a presentation consists of, the order of requests.

Each has an exchange of its own, and ends with the program: a thread that outlived it would
stimulate a person for no program.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from etd.client import clock
from etd.client.course import Course, Ended
from etd.client.exchange import Exchange
from etd.client.session import KEEP_S, Session
from etd.protocol.errors import EtdError

R = TypeVar("R")
#: Makes an exchange that pauses by this function.
NewExchange = Callable[[Callable[[float], None]], Exchange]


class Underway(Generic[R]):
    """A presentation that was begun. `wait` for it, or `end` it early."""

    def __init__(self, new_exchange: NewExchange, course: Course[R]) -> None:
        self._exchange = new_exchange(self._pause)
        self._course = course
        self._ending = threading.Event()
        self._result: R | None = None
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._play, name="etd presents", daemon=True)
        self._thread.start()

    @property
    def is_over(self) -> bool:
        """Whether `wait` would return at once."""
        return not self._thread.is_alive()

    def wait(self, timeout_s: float | None = None) -> R:
        """Blocks until it is over, and says what was fired.

        Raises: TimeoutError; what the presentation was refused with.
        """
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            raise TimeoutError(f"the presentation is not over after {timeout_s:g} s")
        if self._error is not None:
            raise self._error
        result: R = self._result  # type: ignore[assignment]
        return result

    def end(self) -> None:
        """Silence now; `wait` says what was fired until then. Idempotent."""
        self._ending.set()
        self._thread.join()

    def _play(self) -> None:
        try:
            self._result = self._exchange.play(self._course)
        except BaseException as error:  # noqa: BLE001 (`wait` raises it)
            self._error = error
        finally:
            self._exchange.hang_up()

    def _pause(self, seconds: float) -> None:
        if self._ending.wait(seconds):
            raise Ended


class Keeper:
    """Renews the lease, in a `with`, until the program has not come by for `at_most_s`."""

    def __init__(
        self,
        new_exchange: NewExchange,
        session: Session,
        came_by_ns: Callable[[], int],
        at_most_s: float,
    ) -> None:
        self._exchange = new_exchange(clock.sleep_s)
        self._session = session
        self._came_by_ns = came_by_ns
        self._at_most_ns = int(at_most_s * 1e9)
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> None:
        self._ending.clear()
        self._thread = threading.Thread(target=self._keep, name="etd keeps", daemon=True)
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        if self._thread is not None:
            self._thread.join()

    def _keep(self) -> None:
        while not self._ending.wait(KEEP_S):
            has_come_by = clock.now_ns() - self._came_by_ns() <= self._at_most_ns
            if has_come_by and self._session.lease is not None:
                with contextlib.suppress(EtdError):  # the program's next request says why
                    self._exchange.run(self._session.keep())
        self._exchange.hang_up()
