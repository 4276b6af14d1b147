"""A record's summary as lines to read.

Owns: the wording. Must not know: how a figure came about.
"""

from __future__ import annotations

from collections.abc import Iterator

from etd.record.summary import Summary

#: How the end is told; None: the record was cut off.
_ENDS = {
    "stopped": "stopped",
    "full": "FULL: it ended at its bound, or at the disk's, and what came later is missing",
    "ended": "ended with the daemon",
    None: "CUT OFF: still being written, or the gateway was killed, or could not write",
}
#: Of the electrodes, so many are listed.
_LISTED = 64


def lines_of(summary: Summary) -> Iterator[str]:
    yield f"record      {summary.name}, begun {summary.begun}"
    yield f"length      {summary.seconds:.1f} s; {_ENDS[summary.ended]}"
    if summary.board is None:
        yield "board       no engine was there"
    else:
        kind = "" if summary.backend == "linux" else f" ({summary.backend})"
        yield f"board       {summary.board}{kind}, array {summary.array}, {summary.body_site}"
    yield f"person      {', '.join(summary.people) or 'none: no lease stood'}"
    looks = f"; {summary.silent_pulses} probes for contact; {summary.withheld} were withheld"
    yield f"stimuli     {summary.stimuli}, with {summary.pulses} pulses{looks}"
    if summary.unfired_stimuli:
        yield f"WITHHELD    {summary.unfired_stimuli} of them as a whole: etd record csv says which"
    for halt in summary.halts:
        yield f"HALT        {halt.wall or ''} {halt.cause} ({halt.source}): {halt.detail}"
    if summary.engine_ends:
        yield f"ENGINE      ended {summary.engine_ends} times"
    if summary.lost_pulses or summary.lost_lines:
        yield f"LOST        {summary.lost_pulses} pulses and {summary.lost_lines} lines"
    if summary.left_out_requests:
        count = summary.left_out_requests
        yield f"LEFT OUT    {count} requests and replies of users without the lease"
    if summary.dose:
        yield ""
        yield "electrode    pulses     charge (uC)   highest (uA)   through the skin (uA, mean)"
    for dose in summary.dose[:_LISTED]:
        charge_uc = dose.charge_nc / 1_000
        yield (
            f"{dose.electrode:9d} {dose.pulses:9d} {charge_uc:15.3f} {dose.most_ua:14d}"
            f" {dose.mean_ua:14d}"
        )
    if len(summary.dose) > _LISTED:
        yield f"... and {len(summary.dose) - _LISTED} more: --json has all"
