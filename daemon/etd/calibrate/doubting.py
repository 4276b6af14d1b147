"""Which presentation a stop is about: the last one, until the next one begins.

Owns: when that is in the saved progress, and until when. Must not know: questions, procedures, how
a current is presented, where progress is stored.

Pain may stop it while something is presented, instead of an answer, or after one: skin is slower
than a key. The process may also be gone, with no time to say so. So each presentation is in doubt
in the file before it begins and until it is answered, and again where a stop comes before the next
one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from etd.calibrate.in_doubt import InDoubt, is_stop
from etd.calibrate.progress import Progress
from etd.calibrate.stimulator import NotDelivered
from etd.calibrate.trial import Stopped


class Doubting:
    """`on_progress` is called with `progress` when what is in doubt has changed. `last`: what was
    presented before that progress began.
    """

    def __init__(
        self,
        progress: Progress,
        on_progress: Callable[[Progress], None],
        last: InDoubt | None = None,
    ) -> None:
        self._progress = progress
        self._on_progress = on_progress
        #: What a stop now would be about; None: nothing, or what is kept as too strong already.
        self.last = last
        #: Of what is presented, a part was delivered.
        self.is_fired = False

    @contextmanager
    def presented(self, doubt: InDoubt) -> Iterator[None]:
        """While it is. What was not fired at all leaves the presentation before it as the last."""
        before, self.last, self.is_fired = self.last, doubt, False
        self._keep(doubt)
        try:
            yield
        except NotDelivered as error:
            if not self.is_fired and error.fired_ua == 0:
                self.last = before
                self._keep(None)
            raise

    @contextmanager
    def asked(self) -> Iterator[None]:
        """While the question about it stands: an answer ends the doubt, and so does a pause, which
        says that it was bearable. A halt, a lease that lapses and an error say nothing of it.
        """
        self._keep(self.last)
        try:
            yield
        except Stopped as stopped:
            if stopped.answer == "pause":
                self._keep(None)
            raise
        self._keep(None)

    @contextmanager
    def after(self) -> Iterator[None]:
        """In a pause, or a silent trial: it was answered, but a stop may be about it still."""
        try:
            yield
        except BaseException as error:
            if is_stop(error):
                self._keep(self.last)
            raise

    def _keep(self, doubt: InDoubt | None) -> None:
        if self._progress.in_doubt != doubt:
            self._progress.in_doubt = doubt
            self._on_progress(self._progress)
