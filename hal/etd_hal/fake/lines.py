"""The GPIO lines of the header: who holds them, their levels, and the edges of inputs.

Owns: requests, levels and edge events. Must not know: what a line is for.

Released outputs keep their level, as with Raspberry Pi kernels since 2024.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from etd_hal.errors import BusError
from etd_hal.ports import Changes, Edge, LineSetup

_DEVICE = "the fake's GPIO chip"
#: As is asked of the kernel.
_MOST_EDGES_KEPT = 1_024


class Lines:
    def __init__(self, levels: Mapping[int, int]) -> None:
        self._levels = dict(levels)
        self._outputs: frozenset[int] = frozenset()
        self._watched: frozenset[int] = frozenset()
        self._requested: frozenset[int] = frozenset()
        self._consumer: str | None = None
        #: The oldest are lost, as in the kernel's queue.
        self._edges: deque[Edge] = deque(maxlen=_MOST_EDGES_KEPT)
        #: Calls of this request that were checked, in order: drivers repeat a few.
        self._ascending: dict[Changes, list[tuple[int, int]]] = {}

    def request(self, setup: LineSetup) -> None:
        """Take the lines. Raises: BusError (`busy` while a process holds one of them)."""
        wanted = [line for line, _ in setup.outputs] + [entry.line for entry in setup.inputs]
        if len(set(wanted)) != len(wanted):
            raise BusError("invalid", _DEVICE, "request", "a line was asked for twice")
        taken = sorted(self._requested.intersection(wanted))
        if taken:
            held = f"line {taken[0]} is held by {self._consumer}"
            raise BusError("busy", _DEVICE, "request", held)
        self._ascending.clear()
        self._outputs = frozenset(line for line, _ in setup.outputs)
        self._watched = frozenset(entry.line for entry in setup.inputs if entry.edges)
        self._requested = frozenset(wanted)
        self._consumer = setup.consumer
        for entry in setup.inputs:
            self._levels.setdefault(entry.line, 1 if entry.pull == "up" else 0)

    @property
    def outputs(self) -> tuple[int, ...]:
        """In ascending order."""
        return tuple(sorted(self._outputs))

    def is_output(self, line: int) -> bool:
        return line in self._outputs

    def release(self) -> None:
        self._ascending.clear()
        self._outputs = self._watched = self._requested = frozenset()
        self._consumer = None
        self._edges.clear()

    def ascending(self, changes: Changes) -> list[tuple[int, int]]:
        """The changes in the order in which the chip makes them.

        Raises: BusError (`invalid` unless all are outputs of the request; nothing changed).
        """
        ordered = self._ascending.get(changes)
        if ordered is not None:
            return ordered
        for line, value in changes:
            if line not in self._outputs:
                detail = f"line {line} was not requested as an output"
                raise BusError("invalid", _DEVICE, "set", detail)
            if value not in (0, 1):
                raise BusError("invalid", _DEVICE, "set", f"line {line} cannot be {value}")
        ordered = self._ascending[changes] = sorted(changes)
        return ordered

    def level(self, line: int) -> int:
        return self._levels.get(line, 0)

    def put(self, line: int, value: int) -> bool:
        """An output is driven to `value`; tells whether that is a change."""
        changed = self._levels.get(line) != value
        self._levels[line] = value
        return changed

    def read(self, line: int) -> int:
        """Raises: BusError (`invalid` unless the line is held)."""
        if line not in self._requested:
            raise BusError("invalid", _DEVICE, "get", f"line {line} was not requested")
        return self.level(line)

    def move_input(self, t_ns: int, line: int, value: int) -> bool:
        """The world drives an input; tells whether that is a change."""
        if not self.put(line, value):
            return False
        if line in self._watched:
            self._edges.append(Edge(line, value, t_ns))
        return True

    def take_edges(self) -> tuple[Edge, ...]:
        if not self._requested:
            raise BusError("gone", _DEVICE, "edges", "no lines are held")
        edges = tuple(self._edges)
        self._edges.clear()
        return edges
