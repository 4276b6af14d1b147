"""What was too strong is taken from the calibrations that a person may be using, at once: whatever
is being measured may never be finished.

Owns: which calibrations these are, storing them, giving back what a slipped key took, and the
sentences about it. Must not know: what is asked, what was too strong of it, keys.

Another program may store them too, meanwhile. So each is read anew before it is stored, and of what
is there then nothing rises.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from etd.calibrate.conditions import Conditions, identity, other_use
from etd.calibrate.lowered import lowered
from etd.files import resources
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused


class Store(Protocol):
    """The methods used of a display; `etd.Display` has them."""

    def calibrations(self) -> tuple[str, ...]: ...

    def calibration(self, name: str) -> Calibration: ...

    def set_calibration(self, name: str, calibration: Calibration) -> None: ...


class StoredLowered:
    """Those of `names` that are stored, of the person, array and pulses of `made`: what a command
    stands on, and what its result is to replace. The shipped ones are of no person. Raises:
    Refused.
    """

    def __init__(
        self,
        store: Store,
        names: Iterable[str | None],
        made: Conditions | Calibration,
        marked: Callable[[Calibration], Calibration] = lambda made: made,
    ) -> None:
        """`marked`: with what every calibration of this store has."""
        self._store, self._made, self._marked = store, made, marked
        given = dict.fromkeys(name for name in names if name is not None)
        shipped = resources.names("calibrations")
        self._names = tuple(name for name in given if name not in shipped)
        self._known: dict[str, Calibration | None] = dict.fromkeys(self._names)
        self._known |= {name: self._read(name) for name in self._names}
        #: Without what this command has taken.
        self._was = dict(self._known)
        #: Another program has stored these since.
        self._changed: set[str] = set()
        self._left_ua: dict[int, tuple[int, int]] = {}

    def lower(self, left_ua: Mapping[int, tuple[int, int]]) -> None:
        """`left_ua`: of level and cap, after all that was too strong so far, or may have been.
        Raises: Refused.
        """
        if left_ua != self._left_ua:
            for name in self._names:
                self._lower(name, left_ua)
            self._left_ua = dict(left_ua)

    def _lower(self, name: str, left_ua: Mapping[int, tuple[int, int]]) -> None:
        now = self._read(name)
        if now != self._known[name]:
            # Nothing of what another program has stored is taken for this command's own.
            self._changed.add(name)
            self._known[name] = self._was[name] = now
        was = self._was[name]
        if was is None or other_use(was, self._made):
            return
        made = lowered(was, left_ua)
        if made is not was:
            made = self._marked(made)
        if made != now:
            self._store.set_calibration(name, made)
            self._known[name] = made

    def __getitem__(self, name: str) -> Calibration | None:
        """As it is stored now, where it is of this person, array and pulses."""
        now = self._known.get(name)
        return None if now is None or other_use(now, self._made) else now

    def identity_of(self, name: str | None, known: str | None) -> str | None:
        """Of a baseline that was `known` so, and differs by what was too strong only: as what is
        saved is of it as it is now, so that the same command continues.
        """
        now = None if name is None or name in self._changed else self._known.get(name)
        return known if name is None or now is None else identity(name, now)

    @property
    def changed(self) -> tuple[str, ...]:
        """Which another program has stored since this command began. Raises: Refused."""
        return tuple(name for name in self._names if self._is_changed(name))

    def _is_changed(self, name: str) -> bool:
        now = self._read(name)
        return now is not None and (name in self._changed or now != self._known[name])

    @property
    def names(self) -> tuple[str, ...]:
        """Those that it is taken from."""
        return tuple(name for name in self._names if self[name] is not None)

    @property
    def lower_names(self) -> tuple[str, ...]:
        """Those that are lower than they were."""
        return tuple(name for name, was in self._was.items() if self._known[name] != was)

    def tell(self) -> None:
        """On standard error, what is lower than it was."""
        for name in self.lower_names:
            was, now = self._was[name], self._known[name]
            if was is not None and now is not None:
                tell_lowered(name, was, now)

    def _read(self, name: str) -> Calibration | None:
        """None: there is none, or none that could be read from the beginning."""
        if name not in self._store.calibrations():
            return None
        try:
            return self._store.calibration(name)
        except Refused:
            if self._known[name] is not None:
                raise
            return None


def tell_lowered(name: str, was: Calibration, now: Calibration) -> None:
    """Nothing, where no cap is lower."""
    caps = [
        f"{electrode} ({after.cap_ua} uA instead of {before.cap_ua})"
        for electrode, (before, after) in enumerate(zip(was.electrode, now.electrode, strict=True))
        if after != before
    ]
    if caps:
        said = f"too strong, so the cap is lower: electrode {', '.join(caps)}"
        print(f"{said}: {name} is stored so", file=sys.stderr, flush=True)
