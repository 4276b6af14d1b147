"""Stage 7, imperceptible probes: every electrode's switch, found with the load's free end.

Owns: the walk. Must not know: how a person or a fake moves the load.

One end of the load stays on its first electrode. The other end touches every other electrode in
turn, in any order: the first that reads the load, in both polarities, is found. So each output has
been seen on the source's side and on ground. Whether another output switches with it is not seen:
that would be a probe of every other electrode at every touch.
"""

from __future__ import annotations

from etd.selftest.bed import Bed, DummyLoad
from etd.selftest.log import Log
from etd.selftest.probe import TOLERANCE, check_alone, read_map
from etd.selftest.prober import Prober

#: For each electrode, from the last one found.
_WITHIN_MS = 30_000
_LOOK_EVERY_MS = 60


def check(bed: Bed, log: Log, prober: Prober) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    load = bed.asked.load
    if load is None or not bed.is_load_confirmed:
        log.skip("every_switch", "no load was found", "--dummy-load OHM --load-electrodes A,B")
        return
    if bed.operator is None:
        log.skip("every_switch", "nobody is there to move the load", "run it without --no-operator")
        return
    walk = _Walk(bed, prober, load)
    missing = [one for one in range(bed.loaded.array.count) if one != load.first]
    while missing:
        target = missing[0]
        bed.operator.clip(load.first, target)
        found = walk.wait_for(missing)
        if found is None:
            break
        missing.remove(found)
    listed = ", ".join(map(str, missing[:16]))
    log.judge(
        "every_switch",
        not missing,
        f"not found: {listed}" if missing else f"{bed.loaded.array.count} electrodes found",
        "the load, just where it is and in both polarities",
        "touch it longer; if it is not found then, this output or its wire is dead",
    )
    _put_back(bed, log, prober, load)


class _Walk:
    """Looks for the load's free end; one look is one probe at some of the electrodes."""

    def __init__(self, bed: Bed, prober: Prober, load: DummyLoad) -> None:
        self._bed = bed
        self._prober = prober
        # What the load makes of a probe, as measured where it was first.
        told_ua = prober.probe(load.second)[0]
        beside_ohm = 1 / (1 / load.resistance_ohm + 1 / bed.leak_ohm)
        self._load_v = told_ua * beside_ohm / 1e6
        self._slack_v = 2 * TOLERANCE * self._load_v + bed.file.source.node_uv_per_code / 1e6

    def wait_for(self, missing: list[int]) -> int | None:
        """The electrode that the load is on; None if it is on none of them in time."""
        found: list[int] = []

        def look() -> bool:
            found[:] = self._look(missing)
            self._bed.wait_ms(_LOOK_EVERY_MS)
            return len(found) == 1

        return found[0] if self._bed.wait_until(look, _WITHIN_MS) else None

    def _look(self, missing: list[int]) -> list[int]:
        """Those of `missing` that read the load; the one that was asked for is looked at first."""
        if self._reads_load(missing[0]):
            return missing[:1]
        return [one for one in missing[1:] if self._reads_load(one)]

    def _reads_load(self, electrode: int) -> bool:
        return all(
            abs(self._prober.probe(electrode, is_anodic)[1].voltage_v - self._load_v)
            <= self._slack_v
            for is_anodic in (True, False)
        )


def _put_back(bed: Bed, log: Log, prober: Prober, load: DummyLoad) -> None:
    """The load between its two electrodes and nothing else: what comes next is strong."""
    bed.is_load_confirmed = False
    if log.stage_failed or bed.operator is None:
        return
    bed.operator.clip(load.first, load.second)
    walk = _Walk(bed, prober, load)
    is_there = walk.wait_for([load.second]) is not None
    is_back = log.judge(
        "load_back",
        is_there,
        "it is back" if is_there else f"not seen there within {_WITHIN_MS // 1_000} s",
        f"the load is between electrodes {load.first} and {load.second} again",
        "put it back, and begin again",
    )
    is_alone = check_alone(bed, log, read_map(bed, prober), bed.free, "nothing_else")
    bed.is_load_confirmed = is_back and is_alone
