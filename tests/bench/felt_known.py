"""What each electrode of a finger feels at which factor on its current, scan by scan, all known
beforehand.

Owns: asking the body once, and what follows of any course of factors without playing it again. Must
not know: daemons, answers, how a course is found.

Goes by what the body says of each scan (`LivingBody.times_threshold`). What a course would change
in the body itself (who is stimulated more adapts more) is not in it: what counts is played.
"""

from __future__ import annotations

import numpy as np

from bench.felt_person import EXPONENT
from bench.felt_play import ELECTRODES, Unsaid, finger_of, frame_ua, scans, wanted_of
from bench.steady_figures import firm_of
from bench.steady_skin import WIDTH_US
from etd_body.kinds import BodyKind
from etd_body.tissue import Floats

#: The currents, in times of the frame's, at which the body is asked.
_TRIED = (0.75, 1.0, 1.2)


class Known:
    """What each electrode of a finger feels at which factor, scan by scan."""

    def __init__(self, kind: BodyKind, seed: int, minutes: float) -> None:
        finger = finger_of(kind, seed, minutes)
        frame, self.wanted = frame_ua(finger.calibration), wanted_of(finger)
        over: list[list[list[float]]] = []

        def look(now_ns: int) -> None:
            finger.body.look_at(now_ns)
            over.append(
                [
                    [
                        finger.body.times_threshold(electrode, times * frame[electrode], WIDTH_US)
                        for electrode in range(ELECTRODES)
                    ]
                    for times in _TRIED
                ]
            )

        kept, _ = scans(finger, Unsaid(), look)
        self.minutes = minutes
        self.firm = firm_of(kept)
        logs = np.log(np.maximum(np.array(over), 1e-6)).transpose(1, 0, 2)
        # What a body adds between pulses (a neighbor's) is not in what it says of one.
        with np.errstate(divide="ignore"):
            found = np.log(kept.felt) / EXPONENT - logs[1, -len(kept.felt) :]
        is_felt = kept.felt > 0.0
        self._added = np.array(
            [
                np.median(found[is_felt[:, electrode], electrode])
                if is_felt[:, electrode].any()
                else 0.0
                for electrode in range(ELECTRODES)
            ]
        )
        self.at_frame = logs[1]
        tried = np.log(_TRIED)
        self._below = (logs[1] - logs[0]) / (tried[1] - tried[0])
        self._above = (logs[2] - logs[1]) / (tried[2] - tried[1])
        caps = [float(each.cap_ua) for each in finger.calibration.electrode]
        self._cap = np.log(np.array(caps) / np.maximum(frame, 1.0))
        self.is_played = frame > 0.0
        self.count = len(over)

    def felt(self, factors: Floats, part: slice) -> Floats:
        """[course, scan, electrode], of logarithms of factors [course, scan]."""
        by = np.minimum(factors[:, :, None], self._cap)
        slope = np.where(by < 0.0, self._below[part], self._above[part])
        over = self.at_frame[part] + self._added + slope * by
        return np.where((over >= 0.0) & self.is_played, np.exp(EXPONENT * over), 0.0)

    def variations(self, felt: Floats) -> Floats:
        """Over time, by course: as in `steady_figures`; infinite where nothing is felt at all."""
        firm = self.firm
        felt = np.where(firm, felt[:, -len(firm) :], np.nan)[:, :, firm.any(axis=0)]
        mean = np.nanmean(felt, axis=1)
        is_felt = mean > 0.0
        found = np.nanstd(felt, axis=1) / np.where(is_felt, mean, 1.0)
        count = is_felt.sum(axis=1)
        total = np.where(is_felt, found, 0.0).sum(axis=1)
        return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.inf))
