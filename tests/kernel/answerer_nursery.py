"""Starts answerers, one after another, without importing everything again and again.

Owns: one answerer at a time, forked when a line with its arguments comes in; its id and its end go
out. Ends with its standard input. Must not know: what it answers.
"""

from __future__ import annotations

import json
import os
import sys

import answerer


def main() -> int:
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            try:
                answerer.main(
                    json.loads(line), lambda: print(f"answering {os.getpid()}", flush=True)
                )
            except SystemExit as left:
                os._exit(int(left.code or 0))
        _, status = os.waitpid(pid, 0)
        print(f"ended {os.waitstatus_to_exitcode(status)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
