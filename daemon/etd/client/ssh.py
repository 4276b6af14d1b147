"""The way to a daemon on another computer: OpenSSH's client, with keys, agent and configuration as
the person has them.

Owns: that process, the sockets that it forwards, and what it says when it fails. Must not know:
messages, ZeroMQ.

The daemon's sockets are forwarded to Unix sockets in a folder of this process, or to ports of the
loopback where ZeroMQ has no Unix sockets (Windows). At the other end they are opened by the account
that has logged in, so what a client may do is decided there, as for any program of that account. A
command that waits for the end of its input keeps the connection: it ends with this program, however
that ends.
"""

from __future__ import annotations

import re
import shlex
import shutil
import socket
import subprocess
import tempfile
import threading
from collections import deque
from pathlib import Path

from etd.client import clock
from etd.client.calibration_files import check_fits, checked
from etd.client.ssh_command import may_write_there, run_there, ssh_words
from etd.files.calibration import to_toml
from etd.files.calibration_folder import not_permitted
from etd.files.paths import (
    CONTROL,
    FRAMES,
    SYSTEM_CALIBRATIONS,
    SYSTEM_RUNTIME,
    TELEMETRY,
    check_name,
)
from etd.protocol.calibration import Calibration
from etd.protocol.errors import DaemonGone, Refused
from etd.protocol.messages import HelloReply

#: A person may have to type a passphrase.
_READY_WITHIN_S = 60.0
_POLL_S = 0.02
#: What it said is read within that, once it has ended.
_READ_WITHIN_S = 1.0
#: What `ssh` may be given as its destination; never an option.
_HOST = re.compile(r"[^\s-][^\s]*")
_READY, _DENIED, _NONE = "etd:ready", "etd:denied", "etd:none"
_PROBE = """
if [ -w {control} ]; then echo {ready}
elif [ -e {folder} ] && [ ! -x {folder} ] || [ -S {control} ]; then echo {denied}
else echo {none}; fi
exec cat >/dev/null
"""


class SshWay:
    """See the module. `address`: the control socket there, instead of that of the system's daemon
    `name`. Raises: DaemonGone, with what `ssh` has said; Refused (`bad_message`).
    """

    is_here = False

    def __init__(self, host: str, name: str, address: str | None = None) -> None:
        if host.startswith("tcp://"):
            raise Refused(
                "bad_message",
                f"host={host!r}: TCP is refused, since it has no keys; another computer is reached"
                " through ssh: give a host that ssh knows, or user@host",
            )
        if not _HOST.fullmatch(host) or not host.isprintable():
            raise Refused("bad_message", f"host={host!r}: give a host that ssh knows, or user@host")
        remote = _remote_folder(name, address)
        self.place = f"{host}:{remote}"
        self._host, self._name, self._is_named = host, name, address is None
        self._folder = Path(tempfile.mkdtemp(prefix="etd-ssh-"))
        self._said: deque[str] = deque(maxlen=20)
        self._verdict: str | None = None
        here = _unix_sockets(self._folder) if hasattr(socket, "AF_UNIX") else _ports()
        self.control, self.frames, self.telemetry = (zmq for _, zmq in here)
        there = (str(remote / socket_name) for socket_name in (CONTROL, FRAMES, TELEMETRY))
        forwards = [f"{local}:{far}" for (local, _), far in zip(here, there, strict=True)]
        try:
            self._process = _started(host, forwards, _probe_of(remote))
        except OSError as error:
            self._forget_folder()
            raise DaemonGone(
                host, f"ssh cannot be started ({error.strerror})", "install OpenSSH's client"
            ) from error
        self._readers = [
            threading.Thread(target=self._read, args=(stream, take), daemon=True)
            for stream, take in (("stdout", self._take_verdict), ("stderr", self._said.append))
        ]
        for reader in self._readers:
            reader.start()
        try:
            self._wait_until_ready()
        except BaseException:
            self.close()
            raise

    def check_there(self) -> None:
        """The connection could only be made to a daemon."""
        self.check_alive()

    def check_alive(self) -> None:
        """Raises: DaemonGone, once the connection has ended."""
        if self._process.poll() is not None:
            raise DaemonGone(self.place, f"the connection to {self._host} has ended", self._why())

    def check_may_store(self, _: HelloReply) -> None:
        """In the folder of the system's daemon there. Raises: Refused, DaemonGone."""
        folder = SYSTEM_CALIBRATIONS / self._name
        if self._is_named and not may_write_there(self._host, folder):
            raise not_permitted(folder, "a calibration could not be stored")

    def put_calibration(self, facts: HelloReply, name: str, calibration: Calibration) -> None:
        """By a process there. Raises: Refused, DaemonGone."""
        check_fits(calibration, facts)
        self._run_there("import", f"--as={checked(name)}", "--", "-", data=to_toml(calibration))

    def delete_calibration(self, _: HelloReply, name: str) -> None:
        """By a process there. Raises: Refused, DaemonGone."""
        self._run_there("delete", "--", checked(name))

    def _run_there(self, what: str, *words: str, data: str = "") -> None:
        """A command finds a daemon by its name. Raises: Refused (`not_permitted`, and as it was
        refused there), DaemonGone.
        """
        if not self._is_named:
            raise Refused(
                "not_permitted",
                f"the daemon at {self.place} was reached by its address: store and delete its"
                " calibrations there, with `etd calibration`",
            )
        run_there(self._host, ["calibration", what, "--json", f"--name={self._name}", *words], data)

    def close(self) -> None:
        """Ends the connection. Idempotent."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.terminate()
        self._process.wait()
        self._forget_folder()

    def _wait_until_ready(self) -> None:
        deadline_ns = clock.now_ns() + int(_READY_WITHIN_S * 1e9)
        while self._verdict is None:
            if self._process.poll() is not None:
                why = self._why()
                if self._verdict is None:
                    raise DaemonGone(self._host, "ssh could not connect", why)
                break
            if clock.now_ns() >= deadline_ns:
                raise DaemonGone(self._host, f"ssh is not ready after {_READY_WITHIN_S:g} s", "")
            clock.sleep_s(_POLL_S)
        if self._verdict == _DENIED:
            raise DaemonGone(
                self.place,
                "this account may not use the daemon's socket",
                "have its administrator add it to the group that owns the socket (etd-users)",
            )
        if self._verdict != _READY:
            raise DaemonGone(
                self.place, "there is no socket", "is the daemon running there? (etd status there)"
            )

    def _take_verdict(self, line: str) -> None:
        # A login shell may print something first.
        if self._verdict is None and line.startswith("etd:"):
            self._verdict = line

    def _read(self, stream: str, take: object) -> None:
        pipe = getattr(self._process, stream)
        for line in pipe:
            take(line.rstrip())  # type: ignore[operator]

    def _why(self) -> str:
        """What ssh said last, once it has ended."""
        for reader in self._readers:
            # It reads to the end at once, unless a process that ssh left holds the pipe.
            reader.join(_READ_WITHIN_S)
        return self._said[-1] if self._said else "ssh said nothing: try `ssh` by hand"

    def _forget_folder(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)


def _remote_folder(name: str, address: str | None) -> Path:
    if address is None:
        return SYSTEM_RUNTIME / check_name(name)
    path = Path(address.removeprefix("ipc://"))
    if not address.startswith("ipc:///") or path.name != CONTROL:
        raise Refused(
            "bad_message",
            f"{address!r}: with a host it is the control socket there, like"
            f" ipc:///run/user/1000/etd/main/{CONTROL}",
        )
    return path.parent


def _unix_sockets(folder: Path) -> list[tuple[str, str]]:
    """For ssh and for ZeroMQ."""
    paths = [folder / name for name in (CONTROL, FRAMES, TELEMETRY)]
    return [(str(path), f"ipc://{path}") for path in paths]


def _ports() -> list[tuple[str, str]]:
    """The same on the loopback, with ports that are free now."""
    sockets = [socket.socket() for _ in range(3)]
    try:
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        ports = [each.getsockname()[1] for each in sockets]
    finally:
        for each in sockets:
            each.close()
    return [(f"127.0.0.1:{port}", f"tcp://127.0.0.1:{port}") for port in ports]


def _probe_of(folder: Path) -> str:
    words = {"ready": _READY, "denied": _DENIED, "none": _NONE}
    script = _PROBE.format(
        control=shlex.quote(str(folder / CONTROL)), folder=shlex.quote(str(folder)), **words
    )
    return f"sh -c {shlex.quote(script)}"


def _started(host: str, forwards: list[str], command: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        ssh_words(host, forwards, command),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )
