"""What must hold within a line and between lines, beyond the types of its values.

Owns: these rules, so that whoever makes something of a record need not doubt it. Must not know:
files, what is made of a record.
"""

from __future__ import annotations

import msgspec

from etd.protocol.carried import CarriedOver
from etd.protocol.frame import Frame, RateHz
from etd.protocol.pulse_row import PulseRow
from etd.record.lines import Asked, Carried, Count, Engine, Halted, Line, Pulses, Replied, TimeNs


class _AskedFrame(Frame, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """As a record has it: without the lease's token, perhaps with keys of a later version."""

    lease: str = ""


class Consistency:
    """Tell it each line in order."""

    def __init__(self) -> None:
        #: Of the array; None before an engine was there.
        self._electrodes: int | None = None
        #: The numbers of marks that were not answered yet.
        self._marks: set[int] = set()

    def check(self, line: Line) -> None:
        """Raises: msgspec.ValidationError, with what cannot be."""
        if isinstance(line, Pulses):
            self._check_rows(line.rows)
        elif isinstance(line, Asked):
            self._check_request(line)
        elif isinstance(line, Replied):
            self._check_reply(line)
        elif isinstance(line, Carried):
            self._check_carried(line.carried)
            for request in line.frames:
                msgspec.convert(request, _AskedFrame)
        elif isinstance(line, Halted):
            msgspec.convert(line.report.t_ns, TimeNs)
        elif isinstance(line, Engine):
            self._electrodes = msgspec.convert(line.facts.array.electrodes, Count)
            msgspec.convert(line.facts.default_rate_hz, RateHz)

    def _check_rows(self, rows: tuple[PulseRow, ...]) -> None:
        most = max((row.electrode for row in rows), default=-1)
        if self._electrodes is not None and most >= self._electrodes:
            raise msgspec.ValidationError(
                f"a pulse of electrode {most}: the array has {self._electrodes}"
            )

    def _check_carried(self, carried: CarriedOver) -> None:
        msgspec.convert(carried.t_ns, TimeNs)
        if self._electrodes is None:
            raise msgspec.ValidationError("an engine's state before the engine itself")
        most = max((*carried.soft_start.recontacts, *carried.soft_start.were_open), default=-1)
        least = min((*carried.soft_start.recontacts, *carried.soft_start.were_open), default=0)
        if most >= self._electrodes or least < 0:
            raise msgspec.ValidationError(
                f"a ramp of electrode {most if most >= self._electrodes else least}: the array has"
                f" {self._electrodes}"
            )
        known = msgspec.structs.asdict(carried.contacts) if carried.contacts is not None else {}
        for name, values in known.items():
            if len(values) != self._electrodes:
                raise msgspec.ValidationError(
                    f"{name} has {len(values)} values, the array has {self._electrodes}"
                )

    def _check_request(self, line: Asked) -> None:
        op = line.request.get("op")
        if op == "frame":
            msgspec.convert(line.request, _AskedFrame)
        elif op == "mark":
            self._marks.add(line.number)

    def _check_reply(self, line: Replied) -> None:
        if line.number not in self._marks:
            return
        self._marks.discard(line.number)
        if line.ok:
            msgspec.convert(line.reply.get("marked_ns"), TimeNs)
