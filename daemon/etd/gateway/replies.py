"""The replies, each made from the engine's answer.

Owns: their fields. Must not know: sockets, leases, which client waits. (`id` and `now_ns` are
filled in when a reply is sent.)
"""

from __future__ import annotations

from typing import TypeVar

import msgspec

from etd.gateway.lease import StandingLease
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.facts import Endpoints
from etd.protocol.link import Answer, EngineHello
from etd.protocol.messages import (
    LEASE_MS,
    MAX_MESSAGE_BYTES,
    VERSION,
    AccountReply,
    FrameReply,
    HelloReply,
    LeaseReply,
    MarkReply,
    MeasureReply,
    Success,
)
from etd.protocol.opening import LeaseCalibration
from etd.version import __version__

T = TypeVar("T")


def hello(
    engine_hello: EngineHello,
    *,
    name: str,
    endpoints: Endpoints,
    calibrations: tuple[str, ...],
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


def accounted(answer: Answer) -> AccountReply:
    """Raises: Refused (`engine_gone`) for an incomplete answer."""
    return AccountReply(ok=True, now_ns=0, account=_there(answer.account, "account"))


def leased(lease: StandingLease) -> LeaseReply:
    calibrations = tuple(
        LeaseCalibration(name=it.name, polarity=it.calibration.polarity, digest=it.digest)
        for it in lease.calibrations
    )
    return LeaseReply(
        ok=True, now_ns=0, lease=lease.token, lease_ms=LEASE_MS, calibrations=calibrations
    )


def check_fits(calibration: Calibration, engine_hello: EngineHello) -> None:
    """Array and body site; the engine checks its maxima. Raises: Refused (`bad_calibration`)."""
    electrodes = engine_hello.array.electrodes
    for what, given, here in (
        ("array", calibration.array, engine_hello.array.name),
        ("body_site", calibration.body_site, engine_hello.body_site),
        ("number of electrodes", len(calibration.electrode), electrodes),
    ):
        if given != here:
            raise Refused(
                "bad_calibration",
                f"the calibration's {what} is {given}, this daemon's is {here}: use a calibration"
                " made with this configuration",
            )


def _there(part: T | None, what: str) -> T:
    if part is None:
        raise Refused(
            "engine_gone",
            f"the engine's answer lacks {what}: engine and gateway differ in version; restart both",
        )
    return part
