"""The circuit of a pulse in full: every return has its own capacitor.

Owns: the current of each return from the beginning of a pulse on, on skin at rest. Must not know:
caps, shares, the modelled body, which lumps the returns of a pulse.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etd_body.electrode import Contact


def carried_parts(returns: Sequence[Contact], times_us: Sequence[float]) -> list[list[float]]:
    """The part of a constant current that each return carries, at each time after its beginning."""
    series_s = np.array([1.0 / contact.series_ohm for contact in returns])
    parallel_s = np.array([1.0 / contact.parallel_ohm for contact in returns])
    farad = np.array([contact.capacitance_nf * 1e-9 for contact in returns])
    parts = series_s / series_s.sum()
    # A return carries parts + flows @ v, with v the voltages of all capacitors.
    flows = np.outer(parts, series_s) - np.diag(series_s)
    change = (flows - np.diag(parallel_s)) / farad[:, None]
    rates, modes = np.linalg.eig(change)
    at_last_v = -np.linalg.solve(change, parts / farad)
    weights = np.linalg.solve(modes, at_last_v)
    found = []
    for time_us in times_us:
        charged_v = at_last_v - (modes @ (np.exp(rates * time_us * 1e-6) * weights)).real
        found.append([float(part) for part in parts + flows @ charged_v])
    return found
