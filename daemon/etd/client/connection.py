"""What the blocking and the asyncio display share: the session, the address, the sockets.

Owns: which sockets are open to the daemon, and when they are dropped. Must not know: requests, how
a reply is waited for.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, TypeVar

import zmq

from etd.client import clock, wire
from etd.client.array import ElectrodeArray
from etd.client.daemon_clock import DaemonClock
from etd.client.opening import Opening
from etd.client.options import FrameOptions, Kind, frame_fields
from etd.client.patterns import PatternOptions
from etd.client.playing import Playing
from etd.client.session import Session
from etd.client.values import Numbers
from etd.client.way import closed
from etd.client.ways import way_to
from etd.files.paths import DEFAULT_NAME
from etd.protocol.messages import HelloReply
from etd.protocol.opening import LeaseCalibration

S = TypeVar("S", bound="zmq.Socket[Any]")

#: A lease is kept for a program that calls nothing for so long.
KEPT_S = 60.0


class Connection(ABC, Generic[S]):
    """One connection to one daemon.

    `name` is the daemon's; `address` replaces it. `host` is another computer, reached by ssh as
    that is set up here (`pi@display.local`); ETD_HOST stands for it where neither is given. The
    limits come from `calibration` (a name the daemon knows), or from `max_current_ua` (50..10000)
    with `width_us` (20..200), or else from the daemon's default calibration. Several names are one
    person's calibrations, each made with another polarity: a frame may mix these polarities, and
    the first one's is that of a frame that names none. `digest` (one for each name, as `etd
    calibration show` prints it): a calibration with another content is refused. Nothing is felt
    before `arm()`. Nothing is repeated in the background but what `begin` and `kept` are for: a
    frame that is not renewed expires, and a lease that is not renewed for a second ends, which
    disarms.

    Raises, from every method: DaemonGone (no daemon answers), Refused (code, reason, electrode).
    """

    def __init__(
        self,
        name: str = DEFAULT_NAME,
        *,
        host: str | None = None,
        address: str | None = None,
        client: str | None = None,
        calibration: str | Sequence[str] | None = None,
        digest: str | Sequence[str] | None = None,
        max_current_ua: int | None = None,
        width_us: int | None = None,
        timeout_s: float = 2.0,
    ) -> None:
        self._session = Session(
            client or wire.program_name(),
            calibration=calibration,
            digest=digest,
            max_current_ua=max_current_ua,
            width_us=width_us,
            timeout_s=timeout_s,
        )
        self._way = way_to(name, host, address)
        self._session.daemon_clock = DaemonClock(is_here=self._way.is_here)
        self.address = self._way.control
        #: As errors name the daemon: also the computer that it is on, where that is another one.
        self.place = self._way.place
        self._timeout_s = timeout_s
        self._context = self._new_context()
        self._frames: S | None = None
        self._begin()

    @property
    @abstractmethod
    def facts(self) -> HelloReply:
        """Board, array with positions, maxima, calibrations. Raises: Refused (`engine_gone`)."""

    @abstractmethod
    def _new_context(self) -> zmq.Context[S]:
        """Whose sockets block, or are awaited."""

    def _begin(self) -> None:
        """Called when made."""

    @property
    def daemon_clock(self) -> DaemonClock:
        """How far the daemon's clock is ahead of this computer's, as well as it is known."""
        return self._session.daemon_clock

    @property
    def array(self) -> ElectrodeArray:
        """Where the electrodes are. Raises: Refused (`engine_gone`)."""
        return ElectrodeArray(self.facts.array)

    def _fields(self, kind: Kind, numbers: Numbers, options: FrameOptions) -> dict[str, object]:
        """A frame without lease and seq. Raises: Refused (`bad_frame`)."""
        return frame_fields(kind, self._by_electrode(numbers), options)

    def _playing(self, options: PatternOptions) -> Playing:
        """What plays a pattern."""
        tell, on_frame = options.get("tell"), options.get("on_frame")
        return Playing(
            self._session,
            self.address,
            clock.now_ns,
            tell or (lambda _: None),
            on_frame or (lambda _: None),
        )

    def _openings(
        self, levels: Numbers | float | None, currents_ua: Numbers | float | None
    ) -> list[Opening]:
        """What is to be opened to, if anything."""
        given: tuple[tuple[Kind, Numbers | float | None], ...] = (
            ("level", levels),
            ("current_ua", currents_ua),
        )
        return [
            Opening(kind, strengths, self.electrodes, self._by_electrode)
            for kind, strengths in given
            if strengths is not None
        ]

    def _leave_out_unfelt(
        self, openings: Sequence[Opening], taken: Sequence[LeaseCalibration]
    ) -> None:
        """One level opens the electrodes that are felt; which were left out is a warning."""
        unfelt = sorted({electrode for each in taken for electrode in each.unfelt})
        # Where none is felt, the daemon's refusal says so.
        if not unfelt or len(unfelt) == self.electrodes:
            return
        for opening in openings:
            if opening.names_none:
                opening.leave_out(unfelt)
                warnings.warn(
                    "open_to: electrodes that were not felt when they were calibrated are left"
                    f" out: {', '.join(map(str, unfelt))}",
                    stacklevel=3,
                )

    @property
    @abstractmethod
    def electrodes(self) -> int:
        """How many values a frame has."""

    def _by_electrode(self, numbers: Numbers) -> Numbers:
        """A plain list, which most frames have, without a closer look."""
        if isinstance(numbers, (list, tuple)) and not (numbers and hasattr(numbers[0], "__len__")):
            return numbers
        return self.array.by_electrode(numbers)

    def _frames_socket(self) -> S:
        if self._frames is None:
            self._frames = wire.configure(self._context.socket(zmq.PUSH), self._way.frames)
        return self._frames

    def _check_open(self) -> None:
        """Raises: DaemonGone."""
        if self._context.closed:
            raise closed(self._way)

    def _hang_up(self) -> None:
        self._context.destroy(linger=0)
        self._way.close()
