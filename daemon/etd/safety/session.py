"""The session of a person: one person and one calibration, from the first current on.

Owns: when a session begins and ends, and whether the wearer's stop was tested for it. Must not
know: states, hardware, clocks: time is passed in, on the machine's clock. Decision 0039 has the
reasons.

A session begins when the board goes live for a lease, and continues for later leases of the same
calibration. A lease of another calibration ends it, and so do ten minutes in which the board is not
live, or a stop line that ends what is live. A lease with limits and no calibration does not
identify a person: it is a session of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from etd.protocol.calibration import Calibration
from etd.protocol.messages import SessionFacts

#: An unused session ends after this time, and a test of the wearer's stop expires. Longer than the
#: breaks of a study, shorter than a participant's appointment: afterwards there may be another
#: person under the same file, and cable and button may have been moved.
UNUSED_NS = 600_000_000_000
_UNUSED_MINUTES = UNUSED_NS // 60_000_000_000


@dataclass(frozen=True, slots=True)
class Subject:
    """Who a lease is for, as far as it is known."""

    calibration: Calibration | None
    #: Which of the engine's leases it is, where there is no calibration; None where there is one.
    lease_number: int | None = None
    #: Calibrations of the same person for other polarities.
    others: tuple[Calibration, ...] = ()

    @classmethod
    def of(cls, calibrations: Sequence[Calibration], lease_number: int) -> Subject:
        """In whichever order they were named: that says nothing of a person."""
        if not calibrations:
            return cls(None, lease_number)
        first, *others = sorted(calibrations, key=lambda calibration: calibration.polarity)
        return cls(first, others=tuple(others))

    @property
    def participant(self) -> str | None:
        """None: not known."""
        return None if self.calibration is None else self.calibration.participant


@dataclass(slots=True)
class Session:
    """One that has begun. `used_ns`: when the board was last live in it; None while it is."""

    subject: Subject
    begun_ns: int
    used_ns: int | None = None

    def ends_in_ns(self, now_ns: int) -> int | None:
        """How long it still stands without being used; None while the board is live."""
        return None if self.used_ns is None else max(0, self.used_ns + UNUSED_NS - now_ns)

    def __str__(self) -> str:
        return f"the session of {self.subject.participant or 'a lease without a calibration'}"


class Sessions:
    """The current session, if there is one, and the tests of the wearer's stop."""

    def __init__(self, *, has_wearer_stop: bool) -> None:
        self._has_wearer_stop = has_wearer_stop
        self._session: Session | None = None
        self._why_none = "there was none since the engine started"
        self._is_pressed = False
        self._tried_ns: int | None = None
        #: Whose lease stands, and whose stood when the stop was tested; None: no lease.
        self._subject: Subject | None = None
        self._tried_by: Subject | None = None

    def standing(self, now_ns: int) -> Session | None:
        session = self._session
        if session is not None and session.ends_in_ns(now_ns) == 0:
            self._end(f"{session} ended after {_UNUSED_MINUTES} minutes without use")
        return self._session

    def facts(self, now_ns: int) -> SessionFacts | None:
        """What `status` says of the session that stands."""
        session = self.standing(now_ns)
        if session is None:
            return None
        ends_in_ns = session.ends_in_ns(now_ns)
        return SessionFacts(
            participant=session.subject.participant,
            ends_in_s=None if ends_in_ns is None else round(ends_in_ns / 1e9, 1),
        )

    def _end(self, why: str) -> None:
        self._session, self._why_none = None, why

    # --- leases and states -------------------------------------------------------------------

    def opened(self, subject: Subject, now_ns: int) -> None:
        """A lease for `subject`: ends the session of another subject, and drops a test of the stop
        that was made under another subject's lease.
        """
        self._subject = subject
        if self._tried_by not in (None, subject):
            self._tried_ns = self._tried_by = None
        session = self.standing(now_ns)
        if session is None or session.subject == subject:
            return
        if subject.calibration is None:
            self._end(
                f"this lease has no calibration, so it may be for another person than {session}"
            )
        else:
            self._end(f"this lease is for another person or calibration than {session}")

    def closed(self) -> None:
        """No lease stands any more."""
        self._subject = None

    def went_live(self, subject: Subject, now_ns: int) -> bool:
        """Current may flow to `subject` from now on: True if that begins a session. This uses up a
        test of the stop.
        """
        self.opened(subject, now_ns)
        is_new = self._session is None
        if self._session is None:
            self._session = Session(subject, now_ns)
        self._session.used_ns = None
        self._tried_ns = self._tried_by = None
        return is_new

    def went_safe(self, now_ns: int) -> None:
        """No current can flow any more. Idempotent."""
        if self._session is not None and self._session.used_ns is None:
            self._session.used_ns = now_ns

    # --- the wearer's stop -------------------------------------------------------------------

    def stopped(self, stop: str) -> None:
        """A stop line has ended what was live: who wears the board says that it may go on, by
        trying the wearer's stop again.
        """
        if self._session is not None:
            self._end(f"{stop} ended {self._session}")

    def stop_moved(self, *, is_open: bool, is_to_stop: bool, now_ns: int) -> None:
        """An edge of the wearer's stop. Press and release count as a test, unless it was pressed
        to stop stimulation: the board was live, or halted by a stop line, by who was not sure of
        it.
        """
        if is_open:
            self._is_pressed = not is_to_stop
        elif self._is_pressed:
            self._is_pressed, self._tried_ns, self._tried_by = False, now_ns, self._subject

    def why_untried(self, subject: Subject, now_ns: int) -> str | None:
        """Why the wearer's stop must be tested before the board goes live for `subject`, with what
        to do; None if no test is needed.
        """
        self.opened(subject, now_ns)
        if not self._has_wearer_stop or self._session is not None:
            return None
        why = self._why_none
        if self._tried_ns is not None:
            if now_ns - self._tried_ns < UNUSED_NS:
                return None
            why = f"the last test was more than {_UNUSED_MINUTES} minutes ago"
        return (
            f"the wearer's stop has not been tested in this session ({why}): press and release it"
            " once, then arm"
        )
