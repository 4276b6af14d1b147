"""What a scan of 64 electrodes takes on the modelled machines, computing and the kernel's demands
included: which configuration keeps which bound, and that a plan's promise is kept in each.
"""

from __future__ import annotations

import pytest

from bench import machines
from bench.machines import Code, Kernel

CODES: tuple[Code, ...] = ("interpreted", "compiled")
KERNELS: tuple[Kernel, ...] = ("not known", "both off")


@pytest.mark.parametrize(("rest_us", "most"), [(200, 1.15), (50, 1.5)])
def test_compiled_on_a_core_that_is_left_alone_a_pi4_keeps_both_bounds(
    rest_us: int, most: float
) -> None:
    scan = machines.measure("pi4", 64, rest_us, "compiled", "both off")
    assert scan.ratio <= most
    assert scan.kept >= 0.99
    assert scan.spun_us < 15.0


def test_where_the_kernel_is_not_known_it_keeps_that_after_200_us_and_not_that_after_50() -> None:
    assert machines.measure("pi4", 64, 200, "compiled", "not known").ratio <= 1.15
    assert machines.measure("pi4", 64, 50, "compiled", "not known").ratio > 1.5


@pytest.mark.parametrize(("rest_us", "most"), [(200, 1.15), (50, 1.5)])
def test_interpreted_it_keeps_neither(rest_us: int, most: float) -> None:
    assert machines.measure("pi4", 64, rest_us, "interpreted", "both off").ratio > most


@pytest.mark.parametrize("machine", ["pi4", "pi3", "zero2w"])
@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("kernel", KERNELS)
def test_what_a_plan_promises_is_kept(machine: str, code: Code, kernel: Kernel) -> None:
    """Where the brake pauses scans, each pause puts the next one off."""
    least = 0.98 if kernel == "both off" else 0.88
    for rest_us in (200, 50):
        scan = machines.measure(machine, 64, rest_us, code, kernel)
        assert least <= scan.kept <= 1.05, scan
