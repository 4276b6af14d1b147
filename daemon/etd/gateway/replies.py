"""The replies, each made from the engine's answer.

Owns: their fields. Must not know: sockets, leases, which client waits. (`id` and `now_ns` are
filled in when a reply is sent.)
"""

from __future__ import annotations

from typing import TypeVar

import msgspec

from etd.gateway.lease import StandingLease
from etd.protocol.errors import Refused
from etd.protocol.facts import Endpoints
from etd.protocol.link import Answer, EngineHello
from etd.protocol.messages import (
    LEASE_MS,
    MAX_MESSAGE_BYTES,
    VERSION,
    AccountReply,
    ArmReply,
    FeltReply,
    FrameReply,
    HelloReply,
    LeaseReply,
    MarkReply,
    MeasureReply,
    Success,
)
from etd.version import __version__

T = TypeVar("T")


def hello(
    engine_hello: EngineHello,
    *,
    name: str,
    endpoints: Endpoints,
    calibrations: tuple[str, ...],
    calibrations_folder: str,
    default_calibration: str | None,
) -> HelloReply:
    """Everything a client needs to know before its first frame: all that the engine said, too."""
    return HelloReply(
        **msgspec.structs.asdict(engine_hello),
        ok=True,
        now_ns=0,
        protocol=VERSION,
        version=__version__,
        name=name,
        default_calibration=default_calibration,
        calibrations=calibrations,
        calibrations_folder=calibrations_folder,
        endpoints=endpoints,
        max_message_bytes=MAX_MESSAGE_BYTES,
        lease_ms=LEASE_MS,
    )


def done(_: Answer) -> Success:
    return Success(ok=True, now_ns=0)


def framed(seq: int, answer: Answer) -> FrameReply:
    """Raises: Refused (`engine_gone`) for an incomplete answer."""
    rate_hz = _there(answer.rate_hz, "rate_hz")
    return FrameReply(
        ok=True,
        now_ns=0,
        seq=seq,
        rate_hz=rate_hz,
        clamped=answer.clamped,
        slowed=answer.slowed,
        calibrated_hz=answer.calibrated_hz,
        trigger_ns=answer.trigger_ns,
    )


def measured(answer: Answer) -> MeasureReply:
    """Raises: Refused (`engine_gone`) for an incomplete answer."""
    contact = msgspec.structs.asdict(_there(answer.contact, "contact"))
    del contact["t_ns"]
    return MeasureReply(ok=True, now_ns=0, **contact)


def marked(answer: Answer) -> MarkReply:
    """Raises: Refused (`engine_gone`) for an incomplete answer."""
    marked_ns = _there(answer.marked_ns, "marked_ns")
    return MarkReply(ok=True, now_ns=0, marked_ns=marked_ns, sync=answer.sync)


def heard(answer: Answer) -> FeltReply:
    """Raises: Refused (`engine_gone`) for an incomplete answer."""
    felt = _there(answer.felt, "felt")
    return FeltReply(ok=True, now_ns=0, did=felt.did, reason=felt.reason)


def accounted(answer: Answer) -> AccountReply:
    """Raises: Refused (`engine_gone`) for an incomplete answer."""
    return AccountReply(ok=True, now_ns=0, account=_there(answer.account, "account"))


def leased(lease: StandingLease, answer: Answer) -> LeaseReply:
    return LeaseReply(
        ok=True,
        now_ns=0,
        lease=lease.token,
        lease_ms=LEASE_MS,
        calibrations=answer.calibrations,
    )


def armed(answer: Answer) -> ArmReply:
    return ArmReply(ok=True, now_ns=0, calibrations=answer.calibrations)


def _there(part: T | None, what: str) -> T:
    if part is None:
        raise Refused(
            "engine_gone",
            f"the engine's answer lacks {what}: engine and gateway differ in version; restart both",
        )
    return part
