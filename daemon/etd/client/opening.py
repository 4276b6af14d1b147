"""The opening of a person's session: levels are fired until the soft start lets them through.

Owns: the frames of an opening, and when it is done. Must not know: sockets, sleeping, the order of
requests.

The daemon raises the soft start's ceiling by what is fired, and by nothing else, and tells in the
reply to each frame what it still cuts.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from numbers import Real
from typing import cast

from etd.client.options import Kind, frame_fields, renewal_s, silent_fields
from etd.client.values import Numbers
from etd.protocol.errors import Refused
from etd.protocol.messages import FrameReply

_RISING = ("soft_start", "recontact")
#: 10 mA take 2.5 s at usual rates, and a pulse a second still rises in this time.
_WITHIN_NS = 30_000_000_000


class Opening:
    """`strengths`: one number for all electrodes, or one for each; levels, or currents in uA. One
    level is meant for all that are felt (`leave_out`).
    """

    def __init__(
        self,
        kind: Kind,
        strengths: Numbers | float,
        electrodes: int,
        by_electrode: Callable[[Numbers], Numbers],
    ) -> None:
        """`by_electrode`: one number for each, from a mapping or rows."""
        if isinstance(strengths, bool):
            key = "open_to" if kind == "level" else "open_to_ua"
            raise Refused(
                "bad_message",
                f"{key}={strengths}: it says to which strength, as {key}="
                f"{0.8 if kind == 'level' else 500}; None opens nothing",
            )
        #: Whether it is one level, which names no electrode.
        self.names_none = kind == "level" and isinstance(strengths, Real)
        if isinstance(strengths, Real):
            numbers: Numbers = [float(strengths)] * electrodes
        else:
            # Numbers of numpy are `Real` too, but a type checker does not know that of `float`.
            numbers = by_electrode(cast("Numbers", strengths))
        # All electrodes at once may not fit at their rate; the ceiling rises at a lower one too.
        self._fields = frame_fields(kind, numbers, {"allow_slower": True})
        #: From the first frame on: arming takes its own time.
        self._until_ns: int | None = None
        self.renewal_s = renewal_s(self._fields)
        self._kind = kind

    def leave_out(self, unfelt: Collection[int]) -> None:
        """Open all others: a level has no meaning on these, and one number has not named them."""
        levels = self._fields[self._kind]
        if isinstance(levels, list):
            self._fields[self._kind] = [
                0.0 if electrode in unfelt else level for electrode, level in enumerate(levels)
            ]

    def frame(self, now_ns: int) -> dict[str, object]:
        """The next frame to send."""
        if self._until_ns is None:
            self._until_ns = now_ns + _WITHIN_NS
        return {**self._fields, "sent_ns": now_ns}

    def silence(self, now_ns: int) -> dict[str, object]:
        """The frame to end with."""
        return silent_fields(self._fields, now_ns)

    def is_overdue(self, now_ns: int) -> bool:
        return self._until_ns is not None and now_ns > self._until_ns

    def _check_caps(self, reply: FrameReply) -> None:
        """Raises: Refused (`over_limit`): to what is above a cap it never opens."""
        for clamp in reply.clamped:
            if clamp.reason == "cap":
                raise Refused(
                    "over_limit",
                    f"electrode {clamp.electrode} gets {clamp.allowed_ua} uA at most"
                    f" ({clamp.wanted_ua} asked for): open to what its cap allows",
                    clamp.electrode,
                )

    def is_done(self, reply: FrameReply, now_ns: int) -> bool:
        """Whether nothing is cut any more. Raises: Refused (`wrong_state`) if nothing is touched,
        or it takes too long; `over_limit` for more than a cap.
        """
        rising = [clamp for clamp in reply.clamped if clamp.reason in _RISING]
        if not rising:
            wanted = self._fields[self._kind]
            asked = sum(map(bool, wanted)) if isinstance(wanted, list) else 0
            open_ones = [clamp for clamp in reply.clamped if clamp.reason == "contact_open"]
            if asked and len(open_ones) == asked:
                raise Refused(
                    "wrong_state",
                    "nothing touches the display: touch it, then arm again, and it opens",
                )
            self._check_caps(reply)
            return True
        if self.is_overdue(now_ns):
            first = rising[0]
            raise Refused(
                "wrong_state",
                f"electrode {first.electrode} still gets {first.allowed_ua} of {first.wanted_ua} uA"
                f" ({first.reason}): is it touched?",
                first.electrode,
            )
        return False
