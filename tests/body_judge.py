"""Judges an engine by what its body got, and by what its state may be.

Owns: the bounds, figured by hand from the client's limits and the site's maxima, and what was seen
at the last look: no phase has more charge than a client's limits allow, no electrode gets more than
the ledger has or than the maxima of a second, without an armed board nothing but a probe flows, and
a halt stays until a clear. Must not know: what is done to the engine.
"""

from __future__ import annotations

import msgspec

from campaign.account import Account, AccountedBody
from charge_witness import Witness
from engine_rig import EngineRig
from etd.protocol.link import ArmBoard, ClearHalt, MeasureContact, OpenLease, ToEngine
from etd.protocol.messages import Halt, Limits

MS = 1_000_000
#: A message that is longer was held up: not compared before it is settled.
_LONGEST_NS = 300_000
#: A command that probes may wait so long in its socket.
_PROBES_WITHIN_NS = 60 * MS
#: The codes of a DAC are steps, and the body's sums are of floats.
_SLACK = 1.01
_PC_PER_NC = 1_000
_decoder: msgspec.msgpack.Decoder[ToEngine] = msgspec.msgpack.Decoder(ToEngine)


class Judge:
    """Looks after each act, and once more at the end."""

    def __init__(self, rig: EngineRig, witness: Witness, body: AccountedBody) -> None:
        self._rig, self._witness, self._body = rig, witness, body
        parts = rig.engine.components
        self._maxima = parts.loaded.body_site.maxima
        most = parts.loaded.board.maxima
        self._allowed_pc = float(most.probe_current_ua * most.probe_width_us)
        self._probed_ns = self._cleared_ns = -_PROBES_WITHIN_NS
        #: False: skin or faults may let an electrode carry more than is known.
        self.is_even = True
        self.is_whole = True
        self._before = self._account()
        self._state_before, self._halt_before = rig.state, self._halt
        witness.begin(parts.ledger, _LONGEST_NS)

    @property
    def _halt(self) -> Halt | None:
        return self._rig.engine.supervisor.states.halt

    def _account(self) -> Account:
        # Between two turns no current flows, so that all is counted.
        return self._body.counted()

    def opened(self, limits: Limits | None) -> None:
        """With these limits, or with a calibration: then the site's maxima are the bound."""
        most = self._maxima
        allowed_pc = float(most.charge_nc * _PC_PER_NC)
        if limits is not None:
            current_ua = min(limits.max_current_ua, most.uncalibrated_current_ua)
            allowed_pc = min(allowed_pc, current_ua * min(limits.width_us, most.width_us))
        self._allowed_pc = max(self._allowed_pc, allowed_pc)

    def heard(self, data: bytes) -> None:
        """What is on its way to the engine."""
        try:
            message = _decoder.decode(data)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return
        if isinstance(message, OpenLease):
            self.opened(message.limits)
        elif isinstance(message, ArmBoard | MeasureContact):
            self.probes()
        elif isinstance(message, ClearHalt):
            self.clears()

    def probes(self) -> None:
        """A command that probes is on its way."""
        self._probed_ns = self._rig.clock.now_ns()

    def clears(self) -> None:
        """A clear is on its way."""
        self._cleared_ns = self._rig.clock.now_ns()

    def look(self) -> None:
        now = self._account()
        self._judge_charge(now)
        self._judge_state(now)
        self._before = now
        self._state_before, self._halt_before = self._rig.state, self._halt

    def _judge_charge(self, now: Account) -> None:
        """Of one phase; and of every second."""
        assert now.longest_alone_pc <= self._allowed_pc * _SLACK, (
            f"{now.longest_alone_pc} pC in one phase, {self._allowed_pc} pC are allowed"
        )
        if self.is_even and now != self._before:
            self._witness.look("between two turns")
            assert self._witness.shortfalls == []
            most_pc = self._maxima.mean_current_ua * 1_000_000
            assert max(self._witness.got_pc()) <= most_pc * _SLACK

    def _judge_state(self, now: Account) -> None:
        state, now_ns = self._rig.state, self._rig.clock.now_ns()
        is_still = state == self._state_before and state in ("SAFE", "HALTED")
        if is_still and now_ns - self._probed_ns > _PROBES_WITHIN_NS:
            assert now.alone_pc == self._before.alone_pc, f"current flowed in {state}"
            assert now.shared_pc == self._before.shared_pc, f"current flowed in {state}"
        if self._halt_before is not None and self._halt != self._halt_before:
            since_ns = now_ns - self._cleared_ns
            assert since_ns <= _PROBES_WITHIN_NS, "a halt ended without a clear"
        assert (self._halt is not None) == (state == "HALTED")
        if state != "ARMED":
            assert self._rig.engine.components.active.schedule is None or state == "PROBE"

    def end(self, problems: tuple[str, ...]) -> None:
        """The engine has ended."""
        if self.is_whole:
            assert problems == ()
            assert self._rig.fake.dac_code == 0
