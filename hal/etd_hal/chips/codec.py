"""What a board asks of the DAC and the ADC that share its chip select.

Owns: the contract that both keep. Must not know: which chips there are; `compose` picks those of a
board file. The guard decodes the same words apart from it, and the fake a third time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Codec:
    """One word under a chip select: it loads the DAC as chip select rises, and what comes back
    meanwhile is a sample of the node as chip select fell, before the word is played.
    """

    #: The bytes that load a code. Raises: ValueError for a code the DAC does not have.
    word: Callable[[int], bytes]
    #: The sample in the bytes that came back. Raises: BoardFault if they are none.
    code_of: Callable[[bytes], int]
