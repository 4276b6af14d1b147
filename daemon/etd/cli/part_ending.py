"""How a part of the daemon ends that cannot go on: by which exit status.

Owns: which errors are refusals, and which are defects. Must not know: what a part does.

systemd starts a part again unless it ends with 1, 2 or 3: settings, use or hardware were refused
then, and would be refused again (systemd/*.service). Any other error is a
defect of the program: while the gateway stays down, software cannot stop anything.
"""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable
from typing import Final

from etd.protocol.errors import BoardFault, BusError, EtdError

#: "Internal software error", as sysexits.h has it.
DEFECT: Final = os.EX_SOFTWARE


def status_of_part(serve: Callable[[Callable[[], None]], int]) -> int:
    """The exit status. `serve` calls what it is handed once it serves: until then an error of ours
    or of the system is a refusal, after that only one of the board.

    Raises: what is a refusal; the caller says what it is, and ends with its status.
    """
    is_serving = False

    def ready() -> None:
        nonlocal is_serving
        is_serving = True

    try:
        return serve(ready)
    except Exception as error:
        if isinstance(error, (BoardFault, BusError) if is_serving else (EtdError, OSError)):
            raise
        traceback.print_exc()
        return DEFECT
