"""What follows for a person's levels of how use was felt: a sentence of `etd check` and others.

Owns: the sentence, with the figures of the law that raises. Must not know: files, when answers may
raise (etd.protocol.adaptation), terminals.
"""

from __future__ import annotations

import math

from etd.protocol.adaptation import MEASURE_AGAIN, MeasuredAdaptation
from etd.stabilize.said_electrode import fades_a_minute


def raises_in_words(why_not: str | None, adaptation: MeasuredAdaptation | None) -> str:
    """What follows of it, at a body site that allows it."""
    if why_not is not None:
        return f"the person's word raises nothing: {why_not}"
    return (
        "the person's word may raise levels, by at most 5 % a minute and 20 % in all, at a body"
        f" site that allows it (felt_may_raise); {_good_in_words(adaptation)}"
    )


def _good_in_words(adaptation: MeasuredAdaptation | None) -> str:
    if adaptation is None or adaptation.weaker_from_s is None:
        return (
            f"good raises nothing, since it is not told how fast use is felt less: {MEASURE_AGAIN}"
        )
    part = math.exp(fades_a_minute(adaptation.weaker_from_s)) - 1.0
    return f"good makes up for {part:.1%} a minute of use"
