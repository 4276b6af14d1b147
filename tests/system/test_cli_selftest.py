"""A self-test and a daemon after it, as processes."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from command_rig import CommandRig, command_rig

pytestmark = pytest.mark.slow

TEST = ("selftest", "--board", "fake", "--array", "pad-8")
LOAD = ("--dummy-load", "47000", "--second-load", "10000", "--load-electrodes", "0,1")


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def test_a_self_test_that_did_not_pass_keeps_the_supply_off_until_one_does(
    rig: CommandRig,
) -> None:
    assert rig.run(*TEST).status == 1
    with rig.daemon("--array", "pad-8"):
        refused = rig.run("measure")
        assert refused.status == 1
        assert "did not pass: table: truth_table (skip) no dummy load" in refused.err
    assert rig.run(*TEST, *LOAD).status == 0
    with rig.daemon("--array", "pad-8"):
        assert rig.run("measure").status == 0
