"""The frames of a record as a pattern file, which `etd play` shows again.

Owns: how long each frame was up, levels from currents, and what a pattern cannot say. Must not
know: files, calibrations.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any, Literal

from etd.files.pattern import MAX_FRAME_MS, MAX_FRAMES, pattern_of
from etd.protocol.errors import FileError
from etd.record.lines import Engine, Line
from etd.record.stimuli import Stimulus, stimuli_of

#: Which frames become the pattern: levels, or currents, whose highest becomes level 1.
Kind = Literal["levels", "currents"]
_KEYS: dict[Kind, str] = {"levels": "level", "currents": "current_ua"}

#: What a frame may have and a pattern cannot, and what a player can be told instead.
_LEFT_OUT = {
    "width_us": "a pattern has no widths: etd play --width-us",
    "pulses": "a pattern has no numbers of pulses, but the time from the first to the last",
    "returns": "a pattern has no returns",
    "sync": "a pattern has no edges on the SYNC line",
    "on_trigger": "a pattern waits for no edge",
    "rate_hz": "a pattern has one rate for all electrodes of a frame: etd play has its own",
    "polarity": "a pattern has one polarity for all electrodes of a frame: the body site's holds",
}
_TOO_LONG = "duration_ms"


class FramesToPattern:
    """Raises: FileError, PatternError, where no pattern can be made.

    `kind` chooses where a record has levels and currents; None: it must not have both. `left_out`:
    a sentence for each thing that was in the record and is not in the pattern.
    """

    def __init__(self, record: Iterable[Line], source: str, kind: Kind | None = None) -> None:
        self._source = source
        self.electrodes = 0
        self._left_out: Counter[str] = Counter()
        stimuli, self.others = self._chosen(list(stimuli_of(self._noting(record))), kind)
        if len(stimuli) > MAX_FRAMES:
            raise self._no(f"it has {len(stimuli)} stimuli, a pattern {MAX_FRAMES} at most")
        #: What level 1 was in the record; None where levels were asked for.
        self.full_ua = _full_ua(stimuli)
        self._frames = [self._frame(at, stimuli) for at in range(len(stimuli))]
        pattern_of(self.pattern, (), source)

    @property
    def pattern(self) -> dict[str, Any]:
        """As it stands in the file."""
        return {"etd_pattern": 1, "electrodes": self.electrodes, "frames": self._frames}

    @property
    def left_out(self) -> tuple[str, ...]:
        sentences = [
            f"{key} of {count} stimuli: {_LEFT_OUT[key]}"
            for key, count in sorted(self._left_out.items())
            if key in _LEFT_OUT
        ]
        if self._left_out[_TOO_LONG]:
            long = self._left_out[_TOO_LONG]
            sentences.append(f"{long} times: ten minutes are the most of a frame or a pause")
        if self.others:
            sentences.append(f"{self.others} stimuli of the other kind, which was not chosen")
        return tuple(sentences)

    def _noting(self, record: Iterable[Line]) -> Iterable[Line]:
        for line in record:
            if isinstance(line, Engine):
                self.electrodes = line.facts.array.electrodes
            yield line

    def _chosen(self, stimuli: list[Stimulus], kind: Kind | None) -> tuple[list[Stimulus], int]:
        """The stimuli of this kind, and how many there are of the other."""
        if not stimuli:
            raise self._no("nothing was fired in it")
        found = {known: [it for it in stimuli if key in it.asked] for known, key in _KEYS.items()}
        if sum(map(len, found.values())) < len(stimuli):
            raise self._no("it began while a frame was shown, so that frame's contents are missing")
        if kind is None and all(found.values()):
            counts = " and ".join(f"{len(some)} stimuli in {what}" for what, some in found.items())
            raise FileError(
                self._source,
                "",
                f"it has {counts}, whose strengths cannot stand in one pattern",
                "choose which: --of levels, or --of currents",
            )
        chosen = found[kind] if kind is not None else stimuli
        if not chosen:
            raise self._no(f"no stimulus in it was asked for in {kind}")
        return chosen, len(stimuli) - len(chosen)

    def _frame(self, at: int, stimuli: list[Stimulus]) -> dict[str, Any]:
        stimulus = stimuli[at]
        up_ms = max(1, round((stimulus.last_ns - stimulus.first_ns) / 1e6))
        until_ns = stimuli[at + 1].first_ns if at + 1 < len(stimuli) else stimulus.last_ns
        off_ms = max(0, round((until_ns - stimulus.first_ns) / 1e6) - up_ms)
        frame: dict[str, Any] = {
            "duration_ms": self._within(up_ms),
            "off_ms": self._within(off_ms),
            "level": self._levels(stimulus),
        }
        for key in ("rate_hz", "polarity"):
            value = self._one(stimulus, key)
            if value is not None:
                frame[key] = value
        self._left_out.update(
            key for key in ("width_us", "pulses", "returns", "sync", "on_trigger")
            if key in stimulus.asked
        )  # fmt: skip
        return frame

    def _within(self, duration_ms: int) -> int:
        if duration_ms > MAX_FRAME_MS:
            self._left_out[_TOO_LONG] += 1
        return min(duration_ms, MAX_FRAME_MS)

    def _one(self, stimulus: Stimulus, key: str) -> Any:
        """The value of all electrodes that the frame has; None where they have several."""
        value = stimulus.asked.get(key)
        if not isinstance(value, list):
            return value
        strengths = stimulus.asked.get("level") or stimulus.asked.get("current_ua") or ()
        felt = {one for one, strength in zip(value, strengths, strict=False) if strength}
        if len(felt) == 1:
            return felt.pop()
        self._left_out[key] += 1
        return None

    def _levels(self, stimulus: Stimulus) -> list[float]:
        if "level" in stimulus.asked:
            return list(stimulus.asked["level"])
        full_ua = self.full_ua or 1
        return [round(current_ua / full_ua, 4) for current_ua in stimulus.asked["current_ua"]]

    def _no(self, why: str) -> FileError:
        return FileError(self._source, "", why, "a record of frames that were shown")


def _full_ua(stimuli: list[Stimulus]) -> int | None:
    asked = [stimulus.asked["current_ua"] for stimulus in stimuli if "current_ua" in stimulus.asked]
    return max((max(currents, default=0) for currents in asked), default=None)
