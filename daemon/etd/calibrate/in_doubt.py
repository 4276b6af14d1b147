"""The presentation at which a calibration was stopped, or after which, before another one came.

Owns: what a stop is, what is kept of the presentation, the question about it, and what follows of
the answer. Must not know: which one it is (doubting), when it is asked, where it is stored, how a
current is presented.

A person in pain stops it, and answers nothing. When the calibration goes on, the same current would
come again: so it is asked about before anything is presented.
"""

from __future__ import annotations

from typing import Annotated, Final

import msgspec
from msgspec import Meta

from etd.calibrate.answers import Answer, Question, turned
from etd.calibrate.trial import Stopped
from etd.protocol.calibration import Ua
from etd.protocol.errors import DaemonGone, ErrorCode, Refused

Electrode = Annotated[int, Meta(ge=0)]
#: Refusals that end what is presented, whatever was asked for.
_ENDS: Final[tuple[ErrorCode, ...]] = ("halted", "no_lease", "other_lease", "engine_gone")


class InDoubt(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`electrode`, with `reference` if it was compared. If that was too strong, `left_ua` is by
    electrode the most that is left; where all came at once, all levels are taken down by `times`,
    to `together_ua` (empty in a file of before that was kept).
    """

    electrode: Electrode
    reference: Electrode | None = None
    is_reference_last: bool = False
    left_ua: dict[int, Ua] = {}
    together_ua: dict[int, tuple[Ua, Ua]] = {}
    times: Annotated[float, Meta(ge=1.0)] | None = None

    @property
    def question(self) -> Question:
        if self.times is not None:
            return Question("stopped_whole", self.electrode)
        if self.reference is None:
            return Question("stopped", self.electrode)
        return Question("stopped_which", self.electrode, self.reference, self.is_reference_last)

    def left_by(self, answer: Answer) -> dict[int, int]:
        """By electrode, what is left of those that were too strong."""
        if self.is_reference_last:
            answer = turned(answer)
        if answer in ("too_strong", "both"):
            return dict(self.left_ua)
        one = {"first": self.reference, "second": self.electrode}.get(answer)
        return {electrode: ua for electrode, ua in self.left_ua.items() if electrode == one}

    @property
    def electrodes(self) -> frozenset[int]:
        """All that it names."""
        others = () if self.reference is None else (self.reference,)
        return frozenset((self.electrode, *others, *self.left_ua, *self.together_ua))


def is_stop(error: BaseException) -> bool:
    """Whether what ends a pause or a silent trial so may be pain: by a key, a button or a program,
    or because the lease, the process or the daemon ended. Who ends it otherwise has answered what
    was presented, and said no more.
    """
    if isinstance(error, Stopped):
        return error.answer == "stop"
    if isinstance(error, Refused):
        return error.code in _ENDS
    return isinstance(error, DaemonGone) or not isinstance(error, Exception)
