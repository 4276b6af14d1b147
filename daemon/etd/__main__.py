"""The entry point of the command `etd`, and of `python -m etd`.

Owns: that Ctrl-C is an end without a traceback while the command itself is imported, which takes
some tenths of a second. Must not know: verbs.
"""

from __future__ import annotations

import sys

#: As `etd.cli` has it, which may not have been imported.
_INTERRUPTED = 130


def main() -> int:
    """Returns the exit status."""
    try:
        from etd.cli import main as command
    except KeyboardInterrupt:
        return _INTERRUPTED
    return command()


if __name__ == "__main__":
    sys.exit(main())
