"""Checks lease, seq and shape of a client's frame, then passes it on to the engine.

Owns: the order of these checks; seq counts as used once the frame has been sent.
Must not know: limits, currents, whether the engine accepts it.
"""

from __future__ import annotations

from etd.gateway.engine_link import EngineLink
from etd.gateway.last_frames import LastFrames
from etd.gateway.lease import LeaseView, StandingLease
from etd.protocol.frame import Frame, check_shape
from etd.protocol.link import NewFrame
from etd.protocol.messages import FrameRequest

_FIELDS = Frame.__struct_fields__


class FrameHandler:
    """Used by both sockets that frames come in through."""

    def __init__(self, engine: EngineLink, leases: LeaseView, kept: LastFrames) -> None:
        """`kept`: what was passed on and is shown."""
        self._engine = engine
        self._leases = leases
        self._kept = kept

    def check(self, request: FrameRequest, uid: int | None) -> StandingLease:
        """Raises: Refused (those of `check_lease`, `old_seq`, `bad_frame`)."""
        lease = self.check_lease(request.lease, uid)
        self._leases.check_seq(lease, request.seq)
        check_shape(request, self._engine.engine_hello().array.electrodes)
        return lease

    def check_lease(self, token: str, uid: int | None) -> StandingLease:
        """Raises: Refused (`engine_gone`, `halted`, `no_lease`, `other_lease`)."""
        self._engine.engine_hello()
        self._engine.check_not_halted()
        return self._leases.check(token, uid)

    def pass_on(self, request: FrameRequest, lease: StandingLease, ref: int) -> None:
        """Ref 0: the engine reports a refusal and nothing else. Raises: Refused (`busy`)."""
        frame = Frame(**{name: getattr(request, name) for name in _FIELDS})
        self._engine.frame(NewFrame(ref=ref, frame=frame))
        if not request.preview:
            lease.last_seq = request.seq
            self._kept.add(frame)
