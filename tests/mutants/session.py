"""Tests loaded by pytest in this process: measured, and run against one mistake.

Owns: how pytest is told, how long a test may take of the processor, and what counts as found.
Must not know: what the mistakes are, how a mistake comes into the module.

Examples are drawn by a fixed seed, twenty a property: what only a lucky example shows is no test.
"""

from __future__ import annotations

import mmap
import os
import signal
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

# numpy, msgspec and zmq are here to be loaded before the first fork: the modules of ours need them.
import coverage
import hypothesis
import hypothesis.strategies
import msgspec as msgspec
import numpy as numpy
import pytest
import zmq as zmq
from hypothesis import HealthCheck, Phase, settings

EXAMPLES = 20
_PROFILE = "mutants"
_PYTEST = (
    *("-q", "--tb=no", "--capture=no", "--timeout=0", f"--hypothesis-profile={_PROFILE}"),
    *("-p", "no:cacheprovider", "-p", "no:randomly", "-p", "no:xdist"),
    # What is loaded before a fork is loaded before pytest.
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),
    *("-p", "no:faulthandler"),
)
#: Of the processor's time: what a test may take beyond what it took without a mistake, and that
#: time so many times.
_MORE_S, _TIMES = 1.0, 10.0

#: What a fork ends with.
PASSED, FOUND, NOT_SO = 0, 1, 3


def prepare() -> None:
    """Once, before anything is forked."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    settings.register_profile(
        _PROFILE,
        max_examples=EXAMPLES,
        derandomize=True,
        database=None,
        deadline=None,
        phases=(Phase.explicit, Phase.generate),
        suppress_health_check=list(HealthCheck),
    )


class Tests:
    """Those that pytest has collected, by their names."""

    def __init__(self, items: Sequence[pytest.Item], place: mmap.mmap) -> None:
        self._items = {item.nodeid: item for item in items}
        self._place = place
        for item in items:
            _with_few_examples(item)

    @property
    def names(self) -> list[str]:
        return list(self._items)

    def run(self, names: Sequence[str], may_take_s: Callable[[str], float]) -> int:
        """One after another, in a fork of its own: a failure does not come back from here. Where a
        name is of no test, because it is made of what the mistake changes, all tests are run.
        """
        if any(name not in self._items for name in names):
            names = self.names
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        try:
            for index, name in enumerate(names):
                self._place[:4] = index.to_bytes(4, "little")
                after = self._items[names[index + 1]] if index + 1 < len(names) else None
                signal.setitimer(signal.ITIMER_PROF, may_take_s(name))
                self._run(name, after)
        except BaseException:  # noqa: BLE001 - also what ends a program: a mistake shows by it
            os._exit(FOUND)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        return PASSED

    def _run(self, name: str, after: pytest.Item | None) -> None:
        item = self._items[name]
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)

    def measured(self, tracer: coverage.Coverage, tell: Callable[[str, float], None]) -> list[str]:
        """Run all; returns which have failed."""
        failed = _Failed()
        names = self.names
        for index, name in enumerate(names):
            item = self._items[name]
            if index == 0:
                item.config.pluginmanager.register(failed)
            tracer.switch_context(name)
            begun_s = sum(os.times()[:2])
            self._run(name, self._items[names[index + 1]] if index + 1 < len(names) else None)
            tell(name, sum(os.times()[:2]) - begun_s)
        return failed.names


def may_take_s(measured_s: float) -> float:
    return _MORE_S + _TIMES * measured_s


class _Failed:
    def __init__(self) -> None:
        self.names: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.names.append(report.nodeid)


class _EndsAtFailure:
    """A failure ends the process: nobody reads what it would say."""

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        raised = call.excinfo
        may_raise = (pytest.skip.Exception, pytest.xfail.Exception)
        is_expected = item.get_closest_marker("xfail") is not None
        if raised is not None and not is_expected and not raised.errisinstance(may_raise):
            os._exit(FOUND)
        report = yield
        if report.failed:
            os._exit(FOUND)
        return report


class _Session:
    """Instead of running what was collected, hands it on."""

    def __init__(self, use: Callable[[Tests], None], place: mmap.mmap) -> None:
        self._use = use
        self._place = place
        self.is_used = False

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        if not session.testsfailed:
            self.is_used = True
            self._use(Tests(session.items, self._place))
        return True


def collected(
    tree: Path, files: Sequence[str], place: mmap.mmap, use: Callable[[Tests], None], *, ends: bool
) -> bool:
    """Have pytest load these files below `tree`, and `use` what is in them. False: they could not
    be loaded. `ends`: a failure ends the process.
    """
    session = _Session(use, place)
    plugins: list[object] = [session, _EndsAtFailure()] if ends else [session]
    where = (f"--rootdir={tree}", f"--confcutdir={tree}", f"--config-file={tree}/pyproject.toml")
    pytest.main([*_PYTEST, *where, *(str(tree / file) for file in files)], plugins=plugins)
    return session.is_used


def _with_few_examples(item: pytest.Item) -> None:
    """Whatever a test asks for itself."""
    function = getattr(item, "obj", None)
    function = getattr(function, "__func__", function)
    if function is None or not hypothesis.is_hypothesis_test(function):
        return
    asked: settings = function._hypothesis_internal_use_settings
    if asked.max_examples > EXAMPLES:
        few = settings(asked, max_examples=EXAMPLES)
        function._hypothesis_internal_use_settings = few
