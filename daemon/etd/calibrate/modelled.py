"""What the body behind a fake board felt of each presentation, for a simulated person.

Owns: collecting `modelled` telemetry by presentation. Must not know: how a person answers, boards.
Real boards do not send it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from etd.calibrate.asking import Presenter
from etd.calibrate.person import Felt
from etd.calibrate.stimulator import Delivered
from etd.protocol.messages import MODELLED_HZ, Modelled

#: After this time the report with the last pulse has arrived.
_REPORTED_WITHIN_S = 2.5 / MODELLED_HZ


class ModelledBody:
    """Give every report to `hear`."""

    def __init__(self) -> None:
        self._electrode: int | None = None
        self._felt: dict[int, Felt] = {}
        #: Which are presented now, and the strongest that each was felt.
        self._presented: dict[int, float] = {}
        #: The most pain, of any electrode, that any presentation came to; 1 hurts.
        self.most_pain = 0.0

    def begin(self, electrode: int, among: Iterable[int] = ()) -> None:
        """What comes now is of this electrode's presentation; where all of `among` are presented at
        once, of their mean: it stands for them.
        """
        self._electrode = electrode
        self._felt[electrode] = Felt(0.0, 0.0)
        self._presented = dict.fromkeys((*among, electrode), 0.0)

    def end(self) -> None:
        self._electrode = None

    def hear(self, report: object) -> None:
        electrode = self._electrode
        if not isinstance(report, Modelled) or electrode is None:
            return
        before, pain = self._felt[electrode], max(report.pain)
        self.most_pain = max(self.most_pain, pain)
        for each, strongest in self._presented.items():
            self._presented[each] = max(strongest, report.felt[each])
        strength = sum(self._presented.values()) / len(self._presented)
        self._felt[electrode] = Felt(strength, max(before.pain, pain))

    def sense(self, electrode: int) -> Felt:
        """Of the last presentation there."""
        return self._felt[electrode]


class FeltPresenter:
    """Presents with `presenter`, then waits for the body's report."""

    def __init__(self, presenter: Presenter, body: ModelledBody) -> None:
        self._presenter = presenter
        self._body = body
        self.pause = presenter.pause
        self.keep = presenter.keep
        self.stop = presenter.stop

    def present(self, electrode: int, current_ua: int) -> Delivered:
        self._body.begin(electrode)
        try:
            delivered = self._presenter.present(electrode, current_ua)
            self._presenter.pause(_REPORTED_WITHIN_S)
        finally:
            self._body.end()
        return delivered

    def present_whole(self, currents_ua: Mapping[int, int]) -> Delivered:
        self._body.begin(max(currents_ua, key=currents_ua.__getitem__), currents_ua)
        try:
            delivered = self._presenter.present_whole(currents_ua)
            self._presenter.pause(_REPORTED_WITHIN_S)
        finally:
            self._body.end()
        return delivered

    def silence(self, electrode: int) -> Delivered:
        self._body.begin(electrode)
        try:
            delivered = self._presenter.silence(electrode)
            self._presenter.pause(_REPORTED_WITHIN_S)
        finally:
            self._body.end()
        return delivered
