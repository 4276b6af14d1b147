"""The command that opens a lease: with one calibration, with several of a person, or with limits.

Owns: that several belong together before the engine reads them, and which ones are meant. Must not
know: sockets, where calibrations are kept, what the engine grants.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.protocol.calibration_set import check_digest, check_together
from etd.protocol.errors import Refused
from etd.protocol.link import OpenLease
from etd.protocol.messages import Open
from etd.protocol.opening import NamedCalibration, WantedCalibration


def opening(
    request: Open, token: str, calibrations: Sequence[NamedCalibration], ref: int
) -> OpenLease:
    """By names, with the digests of what was read here: what is shown and recorded is then what
    the engine takes, or it refuses. Raises: Refused (`bad_calibration`, `bad_message`).
    """
    digests = request.digests or (None,) * len(calibrations)
    if len(digests) != len(calibrations):
        raise Refused(
            "bad_message",
            f"{len(digests)} digests for {len(calibrations)} calibrations: give one for each",
        )
    for named, digest in zip(calibrations, digests, strict=True):
        check_digest(named.name, named.digest, digest)
    if len(calibrations) > 1:
        check_together([named.calibration for named in calibrations])
    return OpenLease(
        ref=ref,
        lease=token,
        client=request.client,
        calibrations=tuple(
            WantedCalibration(name=named.name, digest=named.digest) for named in calibrations
        ),
        limits=request.limits,
    )
