"""The weak pulses that ask who touches.

Owns: what a probe of each electrode is, for one person on one board. Must not know: when they are
fired, what follows from their answers.
"""

from __future__ import annotations

from etd.array import Array
from etd.engine.limits import PersonLimits, path_of
from etd.engine.plan import Selector
from etd.engine.visit import Visit
from etd.maxima import Maxima
from etd.stabilize.pipeline import Most, Wish


def probes_of(
    board: Selector, array: Array, maxima: Maxima, person: PersonLimits
) -> tuple[Visit, ...]:
    """One for each electrode, in the order of the chain, with all others as returns.

    Weak and short: the probe bound, or the person's limits where they are below it. A cap is of the
    pulses that it was accepted with: a probe is no wider than those, so that it has no more charge.
    """
    outputs = array.outputs()
    everybody = range(array.count)
    width_us = min(maxima.probe_width_us, person.width_us, person.accepted_us)
    currents_ua = [min(maxima.probe_current_ua, cap_ua) for cap_ua in person.caps_ua]
    probes = [
        Visit(
            electrode=one,
            selection=board.selection(outputs[one], None),
            wish=Wish(currents_ua[one], width_us),
            phases=(True,),
            rate_hz=1.0,
            returns=None,
            path=path_of(one, person.caps_ua, [it for it in everybody if it != one], 1.0),
            most=Most(currents_ua[one], width_us, width_us, currents_ua[one] * width_us),
        )
        for one in everybody
    ]
    return tuple(sorted(probes, key=lambda visit: visit.selection.output))
