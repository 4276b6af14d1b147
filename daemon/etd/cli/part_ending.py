"""How a part of the daemon ends that cannot go on: by which exit status.

Owns: which errors are refusals, that would be the same again, and which are nobody's intention.
Must not know: what a part does.

systemd starts a part again unless it ends with 1, 2 or 3: settings, use or hardware were refused
then, and would be refused again (systemd/*.service). An error that no one has foreseen is neither,
and a gateway that stays down because of one takes the stop by software with it.
"""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable
from typing import Final

from etd.protocol.errors import BoardFault, BusError, EtdError

#: "Internal software error", as sysexits.h has it.
UNFORESEEN: Final = os.EX_SOFTWARE


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
        return UNFORESEEN
