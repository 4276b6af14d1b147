"""The replies, each made from the engine's answer.

Owns: their fields. Must not know: sockets, leases, which client waits. (`now_ns` is filled in when
a reply is sent.)
"""

from __future__ import annotations

from collections.abc import Callable

from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.link import Answer, EngineHello
from etd.protocol.messages import (
    LEASE_MS,
    MAX_MESSAGE_BYTES,
    VERSION,
    Endpoints,
    FrameReply,
    Hello,
    HelloReply,
    Id,
    LeaseReply,
    MarkReply,
    MeasureReply,
    Success,
)
from etd.version import __version__


def hello(
    request: Hello,
    now_ns: int,
    engine_hello: EngineHello,
    *,
    name: str,
    endpoints: Endpoints,
    calibrations: tuple[str, ...],
    default_calibration: str | None,
) -> HelloReply:
    """Everything a client needs to know before its first frame."""
    return HelloReply(
        ok=True,
        now_ns=now_ns,
        id=request.id,
        protocol=VERSION,
        version=__version__,
        name=name,
        board=engine_hello.board,
        array=engine_hello.array,
        body_site=engine_hello.body_site,
        maxima=engine_hello.maxima,
        default_width_us=engine_hello.default_width_us,
        default_rate_hz=engine_hello.default_rate_hz,
        default_polarity=engine_hello.default_polarity,
        shape=engine_hello.shape,
        stabilizers=engine_hello.stabilizers,
        default_calibration=default_calibration,
        calibrations=calibrations,
        endpoints=endpoints,
        max_message_bytes=MAX_MESSAGE_BYTES,
        lease_ms=LEASE_MS,
    )


def done(id: Id | None) -> Callable[[Answer], Success]:  # noqa: A002 (the wire's word)
    return lambda _: Success(ok=True, now_ns=0, id=id)


def granted(id: Id | None, lease: str) -> LeaseReply:  # noqa: A002
    return LeaseReply(ok=True, now_ns=0, id=id, lease=lease, lease_ms=LEASE_MS)


def framed(id: Id | None, seq: int, answer: Answer) -> FrameReply:  # noqa: A002
    """Raises: Refused (`engine_gone`) for an incomplete answer."""
    if answer.rate_hz is None:
        raise _incomplete("rate_hz")
    return FrameReply(
        ok=True,
        now_ns=0,
        id=id,
        seq=seq,
        rate_hz=answer.rate_hz,
        clamped=answer.clamped,
        slowed=answer.slowed,
    )


def measured(id: Id | None, answer: Answer) -> MeasureReply:  # noqa: A002
    """Raises: Refused (`engine_gone`) for an incomplete answer."""
    if answer.contact is None:
        raise _incomplete("contact")
    return MeasureReply(
        ok=True,
        now_ns=0,
        id=id,
        contact=answer.contact.contact,
        resistance_ohm=answer.contact.resistance_ohm,
        voltage_v=answer.contact.voltage_v,
        pressure_kpa=answer.contact.pressure_kpa,
    )


def marked(id: Id | None, answer: Answer) -> MarkReply:  # noqa: A002
    """Raises: Refused (`engine_gone`) for an incomplete answer."""
    if answer.marked_ns is None:
        raise _incomplete("marked_ns")
    return MarkReply(ok=True, now_ns=0, id=id, marked_ns=answer.marked_ns, sync=answer.sync)


def check_fits(calibration: Calibration, engine_hello: EngineHello) -> None:
    """A calibration for another array or body site is not stored. The engine checks the maxima when
    it is opened. Raises: Refused (`bad_calibration`).
    """
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


def _incomplete(what: str) -> Refused:
    return Refused(
        "engine_gone",
        f"the engine's answer lacks {what}: engine and gateway differ in version; restart both",
    )
