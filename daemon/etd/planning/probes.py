"""The probes: weak pulses that measure contact.

Owns: the probe of each electrode, for one person on one board. Must not know: when probes are
fired, what follows from their results.
"""

from __future__ import annotations

from etd.files.array import Array
from etd.planning.plan import Selector
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.pulse.request import PulseBounds, PulseRequest
from etd.safety.limits import PersonLimits, path_of
from etd.safety.maxima import Maxima


def probes_of(
    board: Selector, array: Array, maxima: Maxima, person: PersonLimits
) -> tuple[ScheduledPulse, ...]:
    """A probe for each electrode, in the order of the chain, with all others as returns.

    Current and width are the probe maximum, or the person's limits where those are lower. A probe
    is no wider than the pulses that the cap was accepted with, so that it has no more charge.
    """
    outputs = array.outputs()
    everybody = range(array.count)
    width_us = min(maxima.probe_width_us, person.width_us, person.accepted_us)
    currents_ua = [min(maxima.probe_current_ua, cap_ua) for cap_ua in person.caps_ua]
    probes = [
        ScheduledPulse(
            electrode=electrode,
            selection=board.selection(outputs[electrode], None),
            request=PulseRequest(currents_ua[electrode], width_us),
            phases=(True,),
            rate_hz=1.0,
            returns=None,
            path=path_of(electrode, person.caps_ua, [it for it in everybody if it != electrode]),
            bounds=PulseBounds(
                currents_ua[electrode], width_us, width_us, currents_ua[electrode] * width_us
            ),
        )
        for electrode in everybody
    ]
    return tuple(sorted(probes, key=lambda scheduled: scheduled.selection.output))
