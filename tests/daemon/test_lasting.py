"""What a boot forgets: a read-only root has an overlay in memory."""

from __future__ import annotations

from pathlib import Path

import pytest

from etd.files.lasting import why_forgotten

DISK = "/dev/mmcblk0p2 / ext4 rw,noatime 0 0"
OVERLAY = "overlayroot / overlay rw,lowerdir=/lower,upperdir=/upper/data 0 0"
OWN = "/dev/mmcblk0p3 /var/lib/etd ext4 rw 0 0"
MEMORY = "tmpfs /var tmpfs rw 0 0"
SPACED = "tmpfs /var/lib/etd\\040two tmpfs rw 0 0"


@pytest.mark.parametrize(
    ("mounts", "said"),
    [
        ([DISK], None),
        ([OVERLAY], "is on an overlay, as that of a read-only root"),
        ([OVERLAY, OWN], None),
        ([OWN, OVERLAY], None),
        ([DISK, MEMORY], "is in memory"),
        ([DISK, MEMORY, OWN], None),
        ([OVERLAY, DISK], None),
        ([DISK, SPACED], None),
        ([], None),
    ],
)
def test_the_innermost_file_system_says_whether_a_report_stays(
    tmp_path: Path, mounts: list[str], said: str | None
) -> None:
    table = tmp_path / "mounts"
    table.write_text("".join(f"{line}\n" for line in mounts))
    assert why_forgotten(Path("/var/lib/etd/main.selftest.json"), table) == said


def test_a_space_in_a_mount_point_is_read(tmp_path: Path) -> None:
    table = tmp_path / "mounts"
    table.write_text(f"{DISK}\n{SPACED}\n")
    assert why_forgotten(Path("/var/lib/etd two/report"), table) == "is in memory"


def test_where_no_mounts_are_told_nothing_is_said(tmp_path: Path) -> None:
    assert why_forgotten(tmp_path, tmp_path / "nothing") is None
