"""The documented exclusions: on which bodies a law is known to be out of bounds.

Owns: the form of `steady_exclusions.toml`, and what a run says against it: a law that is out where
it is not excluded does not hold, and one that is in where it is excluded is told.
Must not know: how a figure is made, what is out of bounds, how it is shown.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import msgspec

from bench.run import Bound
from bench.steady_harm import BOUND, MOST_TIMES, Harm
from bench.steady_laws import LAWS
from etd_body.kinds import BodyKind

FILE = Path(__file__).with_name("steady_exclusions.toml")


class Excluded(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Of one law, by form. None: it is not played in that form, and may be out nowhere."""

    full: tuple[BodyKind, ...] | None = None
    short: tuple[BodyKind, ...] | None = None
    unbroken: tuple[BodyKind, ...] | None = None
    #: Whose k, where it matters.
    by: str = ""
    why: str = ""

    def on(self, form: str) -> tuple[BodyKind, ...]:
        return self.by_form[form] or ()

    @property
    def by_form(self) -> dict[str, tuple[BodyKind, ...] | None]:
        return {"full": self.full, "short": self.short, "unbroken": self.unbroken}


def documented(file: Path = FILE) -> dict[str, Excluded]:
    """By law. Raises: msgspec.ValidationError; ValueError, where a law is none, or no reason is
    given.
    """
    found = msgspec.toml.decode(file.read_bytes(), type=dict[str, Excluded])
    for law, excluded in found.items():
        if law not in LAWS:
            raise ValueError(f"{file.name}: {law!r} is no law: one of {', '.join(LAWS)}")
        if any(excluded.by_form.values()) and not excluded.why:
            raise ValueError(f"{file.name}: {law!r} is excluded, and `why` is not said")
    return found


def not_excluded(made: Iterable[Harm], form: str, known: Mapping[str, Excluded]) -> list[Bound]:
    """What does not hold: each law that is out on a body that is not among its exclusions."""
    return [
        Bound(
            f"{harm.law} on {harm.body}: out of bounds, and no documented exclusion of the {form}"
            f" form (mend the law, or write it into {FILE.name} with why); of no law's",
            round(harm.worst, 3),
            MOST_TIMES,
            is_met=False,
        )
        for harm in made
        if harm.is_out and harm.body not in known.get(harm.law, Excluded()).on(form)
    ]


def back_in(made: Iterable[Harm], form: str, known: Mapping[str, Excluded]) -> list[str]:
    """Told without failing: exclusions that were played, and were within the bounds this time."""
    return [
        f"{harm.law} on {harm.body}: within the bounds this time (at most {harm.worst:.3g} times no"
        f" law's), and a documented exclusion of the {form} form"
        for harm in made
        if not harm.is_out and harm.body in known.get(harm.law, Excluded()).on(form)
    ]


def free_of_exclusions(known: Mapping[str, Excluded], laws: Sequence[str] = BOUND) -> list[Bound]:
    """What must hold of what ships or is recommended: no exclusion, in any form."""
    counted = {law: known.get(law, Excluded()) for law in laws}
    return [
        Bound(
            f"{law}: ships or is recommended; documented exclusions",
            sum(len(of.on(form)) for form in of.by_form),
            0.0,
            is_met=not any(of.by_form.values()),
        )
        for law, of in counted.items()
    ]
