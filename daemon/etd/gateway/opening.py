"""The command that opens a lease: with one calibration, with several of a person, or with limits.

Owns: that several belong together before the engine gets them, and that they fit into one message.
Must not know: sockets, where calibrations are kept, what the engine grants.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from etd.protocol.calibration_set import check_together
from etd.protocol.errors import Refused
from etd.protocol.link import MAX_DATAGRAM_BYTES, OpenLease
from etd.protocol.messages import Open
from etd.protocol.opening import NamedCalibration


def opening(
    request: Open, token: str, calibrations: Sequence[NamedCalibration], ref: int
) -> OpenLease:
    """Raises: Refused (`bad_calibration`, `too_large`)."""
    given = tuple(named.calibration for named in calibrations)
    command = OpenLease(
        ref=ref,
        lease=token,
        client=request.client,
        calibration=given[0] if given else None,
        others=given[1:],
        limits=request.limits,
    )
    if command.others:
        check_together(given)
        size = len(msgspec.msgpack.encode(command))
        if size > MAX_DATAGRAM_BYTES:
            raise Refused(
                "too_large",
                f"the calibrations together have {size} bytes, a command to the engine has at most"
                f" {MAX_DATAGRAM_BYTES}: open with fewer, or calibrate with returns as a ring",
            )
    return command
