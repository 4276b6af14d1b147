"""The checks of a self-test as they are made, passed to the display of progress.

Owns: recording a check. Must not know: boards, files.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.selftest.report import Check, Result

OnCheck = Callable[[Check], None]


class CheckLog:
    """All checks so far; `stage` is the one that writes."""

    def __init__(self, on_check: OnCheck = lambda _: None) -> None:
        self.checks: list[Check] = []
        self.stage = ""
        self._on_check = on_check

    @property
    def stage_failed(self) -> bool:
        return any(check.stage == self.stage and check.result == "fail" for check in self.checks)

    def names(self, result: Result) -> list[tuple[str, str]]:
        """(stage, name) of all checks with this result."""
        return [(check.stage, check.name) for check in self.checks if check.result == result]

    def judge(
        self, name: str, is_good: bool, measured: str, expected: str = "", advice: str = ""
    ) -> bool:
        """Pass or fail; the advice is kept only where it is needed."""
        self._add(
            name, "pass" if is_good else "fail", measured, expected, "" if is_good else advice
        )
        return is_good

    def skip(self, name: str, why: str, advice: str) -> None:
        self._add(name, "skip", why, "", advice)

    def absent(self, name: str, why: str = "the board file says absent") -> None:
        """A guard that the board file declares absent, or that does not apply to this board."""
        self._add(name, "absent", why, "", "")

    def _add(self, name: str, result: Result, measured: str, expected: str, advice: str) -> None:
        check = Check(
            stage=self.stage,
            name=name,
            result=result,
            measured=measured,
            expected=expected,
            advice=advice,
        )
        self.checks.append(check)
        self._on_check(check)
