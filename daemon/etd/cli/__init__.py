"""The `etd` command: a module for each verb, loaded when it is used.

Owns: the list of verbs, how an error becomes a message and an exit status, and what Ctrl-C does.
Must not know: what any verb does. It imports only the standard library and the errors, so that
`etd safe` works when little else does.

On a Python that runs only the client (3.10), the daemon's verbs are refused before their modules,
which need a newer one, are imported.

A verb is a module with HELP, EPILOG (an example), `add_arguments(parser)` and `run(args)`, which
returns the exit status: 0 done, 1 refused or failed, 2 used wrongly, 3 the hardware or the
daemon is not there, 130 ended by Ctrl-C, 128 + its number by another signal.
`args.misused(sentence)` ends with status 2.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from etd.protocol.errors import (
    BusError,
    DaemonGone,
    EtdError,
    HardwareMissing,
    PartEnded,
    PythonTooOld,
    Refused,
)
from etd.protocol.text import shown
from etd.version import __version__
from etd_hal.daemon_python import check_python, is_old

VERBS = (
    "run",
    "demo",
    "play",
    "status",
    "arm",
    "disarm",
    "stop",
    "clear",
    "monitor",
    "lsl",
    "measure",
    "calibrate",
    "calibration",
    "selftest",
    "bench",
    "check",
    "record",
    "note",
    "report",
    "explain",
    "safe",
)

#: Those that start a daemon, or do its work themselves. The others need one that runs somewhere.
DAEMON_VERBS = frozenset(
    ("run", "demo", "selftest", "bench", "check", "report", "explain", "safe"),
)

DONE, NO, USED_WRONGLY, NOT_THERE, INTERRUPTED = 0, 1, 2, 3, 130

_EPILOG = """
first steps, without any hardware:
  etd demo                            shows a moving pattern on a fake board
  etd run --board fake                runs a daemon for your programs, until Ctrl-C
  etd play FILE --board fake          plays a pattern file on a fake board

exit status: 0 done, 1 refused, or a check failed, 2 wrong usage, 3 the hardware or the daemon is
missing, 130 ended by Ctrl-C, 143 by SIGTERM
`etd VERB --help` explains each verb, with an example.
"""


_CLIENT_ONLY = """
This Python runs etd's client. These verbs are the daemon's, and need a newer Python:
{}.
Those listed above are for a daemon that is running, here or elsewhere (--host).

exit status: 0 done, 1 refused, or a check failed, 2 wrong usage, 3 the daemon or a newer Python is
missing, 130 ended by Ctrl-C, 143 by SIGTERM
`etd VERB --help` explains each verb, with an example.
"""


class Terminated(KeyboardInterrupt):
    """A signal asked a verb to end, which does so as on Ctrl-C. Fields: status (to exit with)."""

    def __init__(self, number: int) -> None:
        self.status = 128 + number
        super().__init__(f"ended by {signal.Signals(number).name}")


def main(argv: Sequence[str] | None = None) -> int:
    """The entry point; returns the exit status. Raises: SystemExit (0, 2) for --help and misuse."""
    given = list(sys.argv[1:] if argv is None else argv)
    has_output = _open_standard_streams()
    try:
        try:
            status = _of_verb(given)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # The reader has closed the pipe (`etd monitor | head`): nothing can be printed any more.
        _discard_output()
        return NO
    except Terminated as ended:
        with contextlib.suppress(OSError):  # the terminal may be gone
            print(f"etd: {ended}", file=sys.stderr, flush=True)
        return ended.status
    except KeyboardInterrupt:
        # Also while a verb's modules are loaded.
        return INTERRUPTED
    except OSError as error:
        return _failed(error, as_json="--json" in given)
    if not has_output:
        print("etd: standard output is closed: the answer could not be printed", file=sys.stderr)
        return status or NO
    return status


def _of_verb(given: Sequence[str]) -> int:
    verb = given[0] if given and given[0] in VERBS else None
    as_json = "--json" in given
    if verb in DAEMON_VERBS:
        try:
            check_python(f"etd {verb}")
        except PythonTooOld as error:
            _tell(error, as_json)
            return status_of(error)
    parser = _parser((verb,) if verb else _verbs(), as_json)
    if (no_text := next((each for each in given if not _is_text(each)), None)) is not None:
        # It could stand in no answer and in no message.
        parser.error(f"an argument is no text in UTF-8: {no_text}")
    args, unknown = parser.parse_known_args(given)
    if unknown:
        # By the verb's own parser, whose help has the options that there are.
        getattr(args, "misused", parser.error)(f"unrecognized arguments: {' '.join(unknown)}")
    if verb is None:
        parser.print_help()
        return USED_WRONGLY
    return _answered(args)


def _is_text(argument: str) -> bool:
    try:
        argument.encode()
    except UnicodeEncodeError:
        return False
    return True


def _verbs() -> tuple[str, ...]:
    """Those whose modules this Python can import."""
    return tuple(verb for verb in VERBS if not is_old() or verb not in DAEMON_VERBS)


def _epilog() -> str:
    if not is_old():
        return _EPILOG
    return _CLIENT_ONLY.format(", ".join(verb for verb in VERBS if verb in DAEMON_VERBS))


def _open_standard_streams() -> bool:
    """Open the null device in place of a closed standard stream: a socket or a device opened next
    would get its number, and be written to. False if standard output was closed.
    """
    has_output = sys.stdout is not None
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for name, at in (("stdout", 1), ("stderr", 2)):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(at, "w", closefd=False))
    return has_output


class _Parser(argparse.ArgumentParser):
    """Reports wrong use; the parsers of the verbs have the same class."""

    as_json = False

    def error(self, message: str) -> NoReturn:
        """Raises: SystemExit (2). The sentence, without all options before it; with `--json` it is
        a JSON object too.
        """
        if self.as_json:
            answer = {"ok": False, "error": "used_wrongly", "reason": f"{self.prog}: {message}"}
            print(json.dumps(answer), flush=True)
        self.exit(
            USED_WRONGLY,
            f"{self.prog}: error: {shown(message)}\n`{self.prog} --help` explains its use\n",
        )


class _JsonParser(_Parser):
    as_json = True


def _parser(verbs: Sequence[str], as_json: bool) -> argparse.ArgumentParser:
    """Has all verbs for the help screen, else only the verb that is used."""
    parser = (_JsonParser if as_json else _Parser)(
        prog="etd",
        description="Drive an electro-tactile display.",
        epilog=_epilog(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"etd {__version__}")
    adding = parser.add_subparsers(title="verbs", metavar="VERB")
    for verb in verbs:
        module = importlib.import_module(f"etd.cli.{verb}")
        added = adding.add_parser(
            verb,
            help=module.HELP,
            description=f"{module.HELP[0].upper()}{module.HELP[1:]}.",
            epilog=getattr(module, "EPILOG", None),
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        module.add_arguments(added)
        added.set_defaults(run=module.run, misused=added.error)
    return parser


def _answered(args: argparse.Namespace) -> int:
    """Run the verb; an error becomes a sentence (or a JSON object) and a status."""
    try:
        status = args.run(args)
    except EtdError as error:
        _tell(error, as_json=getattr(args, "json", False))
        return status_of(error)
    return int(status)


def _failed(error: OSError, as_json: bool) -> int:
    """An OSError of a file, a folder, a socket or standard output."""
    try:
        # If the buffered output cannot be written, standard output is what failed.
        sys.stdout.flush()
        _tell(error, as_json)
        sys.stdout.flush()
    except OSError as lost:
        _discard_output()
        print(f"etd: standard output {_unwritable(lost)}", file=sys.stderr)
    return NO


def _discard_output() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


_NOT_THERE_KINDS = ("absent", "busy", "forbidden", "gone", "permission")


def status_of(error: EtdError) -> int:
    """3 where hardware, daemon or a newer Python is not there, 1 for a refusal or a failure."""
    if isinstance(error, PartEnded):
        return error.status
    if isinstance(error, DaemonGone | HardwareMissing | PythonTooOld):
        return NOT_THERE
    if isinstance(error, BusError) and error.kind in _NOT_THERE_KINDS:
        return NOT_THERE
    if isinstance(error, Refused) and error.code == "engine_gone":
        return NOT_THERE
    return NO


def _tell(error: EtdError | OSError, as_json: bool) -> None:
    if as_json:
        print(json.dumps({"ok": False, "error": code_of(error), "reason": _sentence(error)}))
    else:
        print(f"etd: {_printed(error)}", file=sys.stderr)


def _printed(error: EtdError | OSError) -> str:
    """What is missing stands on lines of its own; no other error breaks a line."""
    if isinstance(error, HardwareMissing):
        return "\n  - ".join(map(shown, ("the hardware cannot be used:", *error.problems)))
    return shown(_sentence(error))


def _sentence(error: EtdError | OSError) -> str:
    """The message. The engine's reason for `expired` gives two times only; the rest is added."""
    if isinstance(error, OSError):
        if error.filename is None:
            return f"standard output, or a file that it writes, {_unwritable(error)}"
        return f"{error.filename}: {error.strerror or error}"
    if isinstance(error, Refused) and error.code == "expired":
        return f"the frame arrived after its time, and was not shown: {error}"
    return str(error)


def _unwritable(error: OSError) -> str:
    return f"cannot be written ({error.strerror or error}): free some space, or redirect it"


def code_of(error: EtdError | OSError) -> str:
    """The protocol's code for a refusal; otherwise the kind of error, in the same style."""
    if isinstance(error, Refused):
        return error.code
    kind = "OsError" if isinstance(error, OSError) else type(error).__name__
    return "".join(f"_{text.lower()}" if text.isupper() else text for text in kind).removeprefix(
        "_"
    )
