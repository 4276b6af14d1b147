"""What each return of a pulse carried, by the contacts that the modelled body had at that time.

Owns: the contacts of a story, and the current of each return of each pulse on the wires. Must not
know: what the engine knows of returns, caps, ledgers.

Returns share a current by their conductance against a current that has flowed for long: that is the
circuit of the modelled body. Nothing of what the DAC makes is taken for the board's leak.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from engine_rig import EngineRig
from engine_scenes import phases
from etd_body.electrode import Contact
from trace_decoder import Phase


@dataclass(frozen=True)
class Carried:
    """What one return carried of one phase, and how long before it a contact had changed
    last (inf: none had)."""

    phase: Phase
    electrode: int
    current_ua: float
    settled_ns: float


class ReturnWitness:
    """See the module. It lays contacts on the body of a rig, and remembers when."""

    def __init__(self, rig: EngineRig, contacts: Sequence[Contact]) -> None:
        self._rig = rig
        self._first = tuple(contacts)
        self._changes: list[tuple[int, int, Contact]] = []
        for electrode, contact in enumerate(contacts):
            rig.fake.world.touch(electrode, contact)
        self._began_ns = rig.clock.now_ns()

    def touch(self, electrode: int, contact: Contact) -> None:
        """From now on the electrode has this contact."""
        self._changes.append((self._rig.clock.now_ns(), electrode, contact))
        self._rig.fake.world.touch(electrode, contact)

    def carried(self) -> Iterator[Carried]:
        """Of all pulses so far that could flow, each phase, through each of its returns."""
        conductance_s = [contact.conductance_s for contact in self._first]
        changes, changed_ns = list(self._changes), -math.inf
        output_of = self._rig.engine.components.loaded.array.outputs()
        for phase in phases(self._rig, self._began_ns):
            while changes and changes[0][0] <= phase.from_ns:
                changed_ns, electrode, contact = changes.pop(0)
                conductance_s[electrode] = contact.conductance_s
            opposite = phase.ground if phase.is_anodic else phase.source
            returns = [place for place, output in enumerate(output_of) if output in opposite]
            assert phase.electrode is not None
            beside_s = sum(conductance_s[place] for place in returns)
            if beside_s == 0.0 or conductance_s[phase.electrode] == 0.0:
                continue
            for place in returns:
                current_ua = phase.current_ua * conductance_s[place] / beside_s
                yield Carried(phase, place, current_ua, phase.from_ns - changed_ns)
