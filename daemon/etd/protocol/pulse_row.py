"""A fired pulse as it crosses the link to be recorded: a row of one length, in bytes.

Owns: the columns of a row, and the numbers that stand for words in it. Must not know: what is done
with a row.

Bytes, because a row is made for each pulse: packing takes a fraction of what a message of numbers
and words does.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec import Meta

from etd.protocol.errors import Undecodable
from etd.protocol.frame import Int64, Polarity
from etd.protocol.outcome import ClampReason
from etd.pulse.measured import ContactState

#: What is the same for a pulse that is repeated: electrode, polarity, clamp, limiting electrode;
#: wanted, commanded and prepulse current, width, charge.
SAME = struct.Struct("<hBBhiiifi")
#: What is of one time: time, time of its limits, seq, purpose, contact; delivered current,
#: resistance; samples of both phases.
OWN = struct.Struct("<qqqBBii6f")
#: A row: both, in this order.
ROW_BYTES = SAME.size + OWN.size

#: What a pulse was fired for: a frame; contact of an electrode that the frame leaves silent;
#: contact before arming; and the probe directly before a pulse of a frame.
Purpose = Literal["stimulus", "poll", "measurement", "probe"]
PURPOSES: tuple[Purpose, ...] = get_args(Purpose)
POLARITIES: tuple[Polarity, ...] = get_args(Polarity)
CONTACTS: tuple[ContactState, ...] = get_args(ContactState)
#: 0: no limit lowered it.
CLAMPS: tuple[ClampReason | None, ...] = (None, *get_args(ClampReason))
#: For seq, resistance and limiting electrode: there is none.
NONE = -1

#: What fits into a row, and so what a record may have.
Electrode = Annotated[int, Meta(ge=0, le=2**15 - 1)]
Int32 = Annotated[int, Meta(ge=-(2**31), le=2**31 - 1)]


class PulseRow(msgspec.Struct, frozen=True, array_like=True):
    """A pulse in a record: it began at `t_ns`, and its limits were those of `asked_ns`. One with no
    `current_ua` was due and not fired; the scans tell why.

    Currents in uA; the width in us, of one phase; the charge of all phases in nC, as the ledger has
    it. `delivered_ua` passed the skin at the end of the pulse. `samples_v`: of each phase the
    node's voltage before it, 10 us after its beginning and near its end.
    """

    t_ns: Int64
    asked_ns: Int64
    electrode: Electrode
    purpose: Purpose
    seq: Int64 | None
    polarity: Polarity
    wanted_ua: Int32
    current_ua: Int32
    prepulse_ua: Int32
    width_us: float
    charge_nc: float
    delivered_ua: Int32
    resistance_ohm: Int32 | None
    contact: ContactState
    limited: ClampReason | None
    limited_by: Electrode | None
    samples_v: tuple[float, ...]


def rows_of(data: bytes) -> Iterator[PulseRow]:
    """Raises: Undecodable for bytes that are no rows."""
    if len(data) % ROW_BYTES:
        raise Undecodable(f"{len(data)} bytes are no rows of {ROW_BYTES}")
    for at in range(0, len(data), ROW_BYTES):
        yield _pulse_row(SAME.unpack_from(data, at), OWN.unpack_from(data, at + SAME.size))


def _pulse_row(same: tuple[Any, ...], own: tuple[Any, ...]) -> PulseRow:
    electrode, polarity, clamp, limited_by, wanted_ua, current_ua, prepulse_ua = same[:7]
    t_ns, asked_ns, seq, purpose, contact, delivered_ua, resistance_ohm = own[:7]
    try:
        return PulseRow(
            t_ns,
            asked_ns,
            electrode,
            PURPOSES[purpose],
            None if seq == NONE else seq,
            POLARITIES[polarity],
            wanted_ua,
            current_ua,
            prepulse_ua,
            round(same[7], 2),
            round(same[8] / 1_000, 3),
            delivered_ua,
            None if resistance_ohm == NONE else resistance_ohm,
            CONTACTS[contact],
            CLAMPS[clamp],
            None if limited_by == NONE else limited_by,
            tuple(round(sample_v, 2) for sample_v in own[7 : 7 + 3 * _phases(polarity)]),
        )
    except IndexError:
        raise Undecodable(f"a row with an unknown number in it: {same} {own}") from None


def _phases(polarity: int) -> int:
    return 2 if POLARITIES[polarity].startswith("biphasic") else 1
