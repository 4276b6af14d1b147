"""What a record adds to the report: the dose of each electrode, all halts, and what is not certain.

Owns: words and rounding of these, and whether the record was made with the reported configuration.
Must not know: how a record is read or summed.
"""

from __future__ import annotations

from etd.record.summary import Summary
from etd.report.figures import Figures
from etd.report.text import Section


def differences(summary: Summary, found: Figures) -> tuple[str, ...]:
    """Where the record was made with another configuration than the reported one: a sentence each.
    A record without an engine has none.
    """
    if summary.board is None:
        return ()
    names = {"board": found.board, "array": found.array, "body_site": found.body_site}
    sentences = []
    if summary.backend != found.backend:
        sentences.append(f"the backend was {summary.backend}, and is {found.backend} here")
    for what in sorted(summary.digests.keys() | found.digests.keys()):
        recorded, reported = summary.digests.get(what), found.digests.get(what)
        if recorded == reported:
            continue
        then, now = getattr(summary, what, None), names.get(what)
        which = f", {then} then and {now} now" if then != now else ""
        sentences.append(
            f"the {what.replace('_', ' ')} file is not that of the record{which}"
            f" (SHA-256 {_short(recorded)} then, {_short(reported)} now)"
        )
    return tuple(sentences)


def recorded_sections(summary: Summary, found: Figures) -> list[Section]:
    how_ended = summary.ended or "CUT OFF: it has no last line"
    withheld = f", {summary.unfired_stimuli} of them withheld as a whole"
    rows = [
        ("begun, length", f"{summary.begun}, {summary.seconds:.1f} s; {how_ended}"),
        ("etd", summary.etd),
        ("person", ", ".join(summary.people) or "no lease stood"),
        (
            "stimuli",
            f"{summary.stimuli}{withheld if summary.unfired_stimuli else ''}, with"
            f" {summary.pulses} pulses",
        ),
        ("probes for contact", str(summary.silent_pulses)),
    ]
    rows += [("INCOMPLETE", sentence) for sentence in summary.missing]
    differs = differences(summary, found)
    if summary.board is None:
        rows.append(("configuration", "not compared: no engine was there"))
    elif not differs:
        rows.append(("configuration", "made with the files above"))
    rows += [("OTHER CONFIGURATION", sentence) for sentence in differs]
    dose = [
        (
            f"electrode {dose.electrode}",
            f"{dose.pulses} pulses, {dose.charge_nc / 1_000:.3f} uC, at most"
            f" {dose.most_ua / 1_000:g} mA",
        )
        for dose in summary.dose
    ]
    halts = [
        (halt.wall or "", f"{halt.cause} ({halt.source}): {halt.detail}") for halt in summary.halts
    ]
    return [
        (f"Record {summary.name}", rows),
        ("Dose of each electrode", dose or [("none", "nothing was fired")]),
        ("Halts", halts or [("none", "")]),
    ]


def recorded_sentence(summary: Summary, found: Figures) -> str:
    """For the paragraph of a methods section."""
    cautions = "".join(f" [{each}.]" for each in (*summary.missing, *differences(summary, found)))
    return f"{_given(summary)}{cautions}"


def _given(summary: Summary) -> str:
    if not summary.dose:
        return "In the record nothing was fired."
    pulses = max(dose.pulses for dose in summary.dose)
    charge_nc = max(dose.charge_nc for dose in summary.dose)
    strongest_ua = max(dose.most_ua for dose in summary.dose)
    halts = f"{len(summary.halts)} halt" + ("" if len(summary.halts) == 1 else "s")
    fired = f"{summary.stimuli - summary.unfired_stimuli} stimuli"
    if summary.unfired_stimuli:
        fired += f", and {summary.unfired_stimuli} that the limits withheld as a whole"
    return (
        f"In the session ({summary.seconds / 60:.1f} min, {fired}) no electrode was given more than"
        f" {pulses} pulses, nor more than {charge_nc / 1_000:.1f} uC; the strongest pulse had"
        f" {strongest_ua / 1_000:.2f} mA; there were {halts}."
    )


def _short(digest: str | None) -> str:
    return "none" if digest is None else f"{digest[:12]}..."
