"""By which status a part of the daemon ends, and what the services make of it."""

from __future__ import annotations

from collections.abc import Callable
from configparser import ConfigParser
from pathlib import Path

import pytest

from etd.cli.part_ending import DEFECT, status_of_part
from etd.protocol.errors import BoardFault, BusError, FileError, Refused

SYSTEMD = Path(__file__).resolve().parents[2] / "systemd"
REFUSED = FileError("a.toml", "", "it is none", "write it")


def ends_with(error: Exception, *, is_serving: bool) -> Callable[[Callable[[], None]], int]:
    def serve(on_ready: Callable[[], None]) -> int:
        if is_serving:
            on_ready()
        raise error

    return serve


@pytest.mark.parametrize("error", [REFUSED, OSError(98, "Address already in use")])
def test_what_is_refused_before_it_serves_is_said_by_the_command(error: Exception) -> None:
    with pytest.raises(type(error)):
        status_of_part(ends_with(error, is_serving=False))


@pytest.mark.parametrize("is_serving", [False, True])
def test_a_defect_has_a_status_of_its_own(
    capsys: pytest.CaptureFixture[str], *, is_serving: bool
) -> None:
    assert status_of_part(ends_with(KeyError("gone"), is_serving=is_serving)) == DEFECT
    assert "KeyError: 'gone'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "error", [PermissionError(13, "Permission denied"), REFUSED, Refused("busy", "no")]
)
def test_once_it_serves_no_error_of_a_client_or_of_the_system_is_a_refusal(
    error: Exception,
) -> None:
    assert status_of_part(ends_with(error, is_serving=True)) == DEFECT


@pytest.mark.parametrize(
    "error", [BoardFault("rail", "0 V", "300 V"), BusError("gone", "spi", "a pulse")]
)
def test_a_board_that_fails_is_said_by_the_command(error: Exception) -> None:
    with pytest.raises(type(error)):
        status_of_part(ends_with(error, is_serving=True))


@pytest.mark.parametrize("status", [0, 1])
def test_one_that_ends_by_itself_has_its_own_status(status: int) -> None:
    assert status_of_part(lambda _: status) == status


@pytest.mark.parametrize("unit", ["etd-gateway@.service", "etd-engine@.service"])
def test_the_services_start_it_again_then_and_not_after_a_refusal(unit: str) -> None:
    read = ConfigParser(strict=False, interpolation=None)
    read.read(SYSTEMD / unit)
    assert read["Service"]["Restart"] == "on-failure"
    never = read["Service"]["RestartPreventExitStatus"].split()
    assert never == ["1", "2", "3"]
    assert str(DEFECT) not in never
