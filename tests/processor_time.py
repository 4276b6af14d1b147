"""What the files of tests take of the processor: `make durations`.

Owns: the measuring, beside other tests or alone, and which files ought to be marked `slow`. It is
the processor's time, with that of the processes that a test waits for: what else a machine does
changes it little. Must not know: what is tested.
"""

from __future__ import annotations

import resource
from collections import defaultdict
from collections.abc import Generator

import pytest

#: Of a file, all its tests together, on one core of a PC. `slow` stands in what takes more.
SLOW_S = 2.0
_KEY = "processor_s"
_BEGUN = pytest.StashKey[float]()


def _taken_s() -> float:
    of = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in of)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    item.stash[_BEGUN] = _taken_s()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if call.when == "teardown":
        report.user_properties.append((_KEY, _taken_s() - item.stash[_BEGUN]))
    return report


class _Files:
    """Where reports arrive: in the one process that has the terminal."""

    def __init__(self) -> None:
        self._taken_s: defaultdict[str, float] = defaultdict(float)
        self._slow: set[str] = set()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        name = report.nodeid.partition("::")[0]
        for key, value in report.user_properties:
            if key == _KEY and isinstance(value, float):
                self._taken_s[name] += value
        if "slow" in report.keywords:
            self._slow.add(name)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        tell = terminalreporter.write_line
        terminalreporter.section("processor time of each file")
        for name, taken_s in sorted(self._taken_s.items(), key=lambda one: -one[1]):
            tell(f"{taken_s:8.2f} s  {'slow' if name in self._slow else '    '}  {name}")
        fast_s = sum(s for name, s in self._taken_s.items() if name not in self._slow)
        tell(f"{fast_s:8.2f} s  of {sum(self._taken_s.values()):.0f} s in files that are not slow")
        for name, taken_s in sorted(self._taken_s.items()):
            if name not in self._slow and taken_s > SLOW_S:
                tell(f"mark as slow: {name}")
            elif name in self._slow and taken_s < SLOW_S / 2:
                tell(f"slow no more: {name}")


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(_Files())
