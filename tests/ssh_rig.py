"""A daemon reached over ssh: Debian's sshd on the loopback, with accounts that only it sees.

Owns: keys, accounts and mounts, in a mount namespace of sshd's own; the `ssh` that finds it. Must
not know: what is tested.

In sshd's namespace the daemon's folder is /run/etd, as on a Pi, its calibrations are in
/var/lib/etd-calibrations, and `etd` is a command of each account.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from command_rig import WITHIN_S, CommandRig
from etd.client import clock

SSHD = "/usr/sbin/sshd"
#: Name, user id and group: one is in the daemon's group, the other in none.
MEMBER, STRANGER = ("etd-member", 61_001, 61_001), ("etd-stranger", 61_002, 61_002)
_SERVER = """
Port {port}
ListenAddress 127.0.0.1
HostKey {folder}/host
AuthorizedKeysFile {folder}/key.pub
StrictModes no
UsePAM no
SetEnv PATH={folder}/there:/usr/bin:/bin
PasswordAuthentication no
PidFile none
"""
_CLIENT = """
Host display stranger
    HostName 127.0.0.1
    Port {port}
    IdentityFile {folder}/key
    IdentitiesOnly yes
    StrictHostKeyChecking no
    UserKnownHostsFile /dev/null
    LogLevel ERROR
Host display
    User {member}
Host stranger
    User {stranger}
Host nobody-there
    HostName 127.0.0.1
    Port 1
"""
_MOUNT = """
set -e
mount --make-rprivate /
for file in passwd group shadow; do mount --bind "$1/$file" /etc/$file; done
mount -t tmpfs tmpfs /run
mkdir /run/sshd /run/etd
mount --bind "$2" /run/etd
mount -t tmpfs tmpfs /var/lib
mkdir -p /var/lib/etd-calibrations/main
mount --bind "$3" /var/lib/etd-calibrations/main
# Other accounts may not reach the Python that runs this.
mount --bind "$4" "$1/python"
exec {sshd} -D -e -f "$1/sshd_config"
"""
_ETD = """#!/bin/sh
exec "{folder}/python/bin/python{version}" -c '
import sys
sys.path[:] = {path}
from etd.cli import main
sys.exit(main())
' "$@"
"""


def missing() -> str | None:
    """Why it cannot be played here; None if it can."""
    if os.geteuid() != 0:
        return "it needs root, for accounts of its own"
    if not Path(SSHD).exists() or shutil.which("ssh") is None:
        return "openssh-server is not installed"
    if subprocess.run(["unshare", "-m", "true"], capture_output=True, check=False).returncode:
        return "this machine grants no mount namespace"
    return None


class SshRig:
    """`environment` has an `ssh` that knows the hosts `display`, `stranger` and `nobody-there`."""

    def __init__(self, commands: CommandRig) -> None:
        self.commands: Final = commands
        self.folder: Final = commands.folder / "ssh"
        self.folder.mkdir()
        # Other accounts must get through to the sockets.
        commands.folder.chmod(0o711)
        (commands.folder / "run").chmod(0o711)
        self._daemons = commands.folder / "run" / "etd"
        self._daemons.mkdir(mode=0o755)
        #: The daemon's, which its group of operators writes to: here the member's.
        self.calibrations: Final = commands.folder / "state" / "etd" / "main" / "calibrations"
        self.calibrations.mkdir(parents=True)
        os.chown(self.calibrations, 0, MEMBER[2])
        self.calibrations.chmod(0o2775)
        for name in ("host", "key"):
            command = ("ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", self.folder / name)
            subprocess.run(command, check=True)
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self._write_files(port)
        mount = _MOUNT.format(sshd=SSHD)
        self._log = (self.folder / "log").open("w")
        self._server = subprocess.Popen(
            [
                *("unshare", "-m", "sh", "-c", mount, "sh"),
                *(self.folder, self._daemons, self.calibrations, sys.base_prefix),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._log,
        )
        path = f"{self.folder}:{os.environ['PATH']}"
        self.environment = commands.environment = {**commands.environment, "PATH": path}
        self._wait(port)

    def admit(self) -> None:
        """The daemon's sockets belong to the member's group, as systemd and the gateway see to."""
        for path in (self._daemons / "main", *(self._daemons / "main").iterdir()):
            os.chown(path, -1, MEMBER[2])
        for path in (self._daemons / "main").glob("*.sock"):
            path.chmod(0o660)

    def ssh_processes(self) -> list[int]:
        """Clients that use this rig's key."""
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            try:
                words = (process / "cmdline").read_bytes()
            except OSError:
                continue
            if words.startswith(b"/usr/bin/ssh\0") and str(self.folder).encode() in words:
                found.append(int(process.name))
        return found

    def close(self) -> None:
        self._server.terminate()
        self._server.wait(WITHIN_S)
        self._log.close()

    def _write_files(self, port: int) -> None:
        for name, entry in (
            ("passwd", "{0}:x:{1}:{2}::/:/bin/sh"),
            ("group", "{0}:x:{2}:"),
            ("shadow", "{0}:*:19000:0:99999:7:::"),
        ):
            lines = [Path("/etc", name).read_text("utf-8").rstrip("\n")]
            lines += [entry.format(*account) for account in (MEMBER, STRANGER)]
            (self.folder / name).write_text("\n".join(lines) + "\n", "utf-8")
            (self.folder / name).chmod(0o600 if name == "shadow" else 0o644)
        words = {"port": port, "folder": self.folder, "member": MEMBER[0], "stranger": STRANGER[0]}
        (self.folder / "sshd_config").write_text(_SERVER.format(**words), "utf-8")
        (self.folder / "ssh_config").write_text(_CLIENT.format(**words), "utf-8")
        there = self.folder / "there"
        for made in (there, self.folder / "python"):
            made.mkdir(mode=0o755)
        path = [place for place in sys.path if not place.startswith(sys.base_prefix)]
        base = [place for place in sys.path if place.startswith(sys.base_prefix)]
        moved = [place.replace(sys.base_prefix, f"{self.folder}/python", 1) for place in base]
        version = f"{sys.version_info[0]}.{sys.version_info[1]}"
        text = _ETD.format(folder=self.folder, version=version, path=json.dumps([*moved, *path]))
        (there / "etd").write_text(text, "utf-8")
        (there / "etd").chmod(0o755)
        wrapper = self.folder / "ssh"
        wrapper.write_text(f'#!/bin/sh\nexec /usr/bin/ssh -F {self.folder}/ssh_config "$@"\n')
        wrapper.chmod(0o755)
        self.folder.chmod(0o711)
        (self.folder / "key.pub").chmod(0o644)

    def _wait(self, port: int) -> None:
        deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
        while clock.now_ns() < deadline_ns:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    return
            assert self._server.poll() is None, (self.folder / "log").read_text()
            clock.sleep_s(0.02)
        raise AssertionError("sshd does not listen")


@contextmanager
def ssh_rig(commands: CommandRig) -> Iterator[SshRig]:
    rig = SshRig(commands)
    try:
        yield rig
    finally:
        rig.close()
