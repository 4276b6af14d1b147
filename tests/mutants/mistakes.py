"""Every small mistake that a module may have: where it stands, its name, the module with it.

Owns: which mistakes are made of a source, and their names, which outlive edits elsewhere in it.
Must not know: tests, processes, which of them are found.

Left as they are: words for a reader, annotations, decorators, `__slots__`, and what only a type
checker reads. Mistakes of an expression in a message are made: a figure that a reader is told
wrongly is no word.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import CodeType
from typing import Any

#: A string without a space and a sentence is read by programs: a code, a key, a state.
_FOR_PROGRAMS = re.compile(r"[a-z][a-z0-9]*([_.\-][a-z0-9]+)*")
#: So long may each side of a name's "before -> after" be.
_SHOWN = 60

_COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Div,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
}
_CALLED = {"min": "max", "max": "min", "any": "all", "all": "any", "ceil": "floor", "floor": "ceil"}


@dataclass(frozen=True)
class Place:
    """Where a node stands: in this field of its parent, and at this index if that is a list."""

    parent: ast.AST
    field: str
    index: int | None

    def put(self, node: object) -> None:
        if self.index is None:
            setattr(self.parent, self.field, node)
        else:
            getattr(self.parent, self.field)[self.index] = node


@dataclass(frozen=True)
class Mutant:
    """One mistake."""

    #: The function, the line as it is written, and what became of it.
    name: str
    #: Of the statement, or of its first lines if others are within it.
    lines: range
    #: Whether it is made when the module is loaded, outside of every function.
    is_of_module: bool
    place: Place
    before: ast.AST
    after: ast.AST


class Mutated:
    """A module, with one of its mistakes at a time."""

    def __init__(self, source: str, filename: str) -> None:
        self._filename = filename
        self._tree = ast.parse(source)
        self.mutants = list(_named(_Mistakes(source, self._tree).found))

    def compiled(self, mutant: Mutant | None) -> CodeType:
        """The whole module; None: as it is."""
        if mutant is None:
            return self._compiled()
        mutant.place.put(mutant.after)
        try:
            return self._compiled()
        finally:
            mutant.place.put(mutant.before)

    def _compiled(self) -> CodeType:
        return compile(self._tree, self._filename, "exec", dont_inherit=True)


def _named(found: list[Mutant]) -> Iterator[Mutant]:
    """The same mistake in a line that is written twice gets a number from its second place on."""
    seen: Counter[str] = Counter()
    for one in found:
        seen[one.name] += 1
        count = seen[one.name]
        name = one.name if count == 1 else f"{one.name} #{count}"
        yield Mutant(name, one.lines, one.is_of_module, one.place, one.before, one.after)


class _Mistakes:
    """Goes through a module once."""

    def __init__(self, source: str, tree: ast.Module) -> None:
        self.found: list[Mutant] = []
        self._source = source.splitlines()
        self._within: list[str] = []
        self._is_of_module = True
        self._lines = range(0)
        #: How often each name is assigned in the function that is being read.
        self._assigned: Counter[str] = Counter()
        self._block(tree, "body")

    # --- statements ------------------------------------------------------------------------

    def _block(self, parent: ast.AST, field: str) -> None:
        statements: list[ast.stmt] = getattr(parent, field)
        for index, statement in enumerate(statements):
            if index == 0 and _is_docstring(statement):
                continue
            self._statement(Place(parent, field, index), statement)

    def _statement(self, place: Place, node: ast.stmt) -> None:
        self._lines = range(node.lineno, _last_line(node) + 1)
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                self._function(node)
                return
            case ast.ClassDef():
                self._within.append(node.name)
                self._block(node, "body")
                self._within.pop()
                return
            case ast.If() if _is_for_types(node.test):
                self._block(node, "orelse")
                return
            case ast.Import() | ast.ImportFrom():
                return
            case ast.Assign(targets=[ast.Name(id="__slots__" | "__all__")]):
                return
            case ast.If(test=test):
                self._condition(Place(node, "test", None), test, (True, False))
            case ast.While(test=test):
                self._condition(Place(node, "test", None), test, (False,))
            case ast.AugAssign(op=operator):
                self._operator(node, Place(node, "op", None), operator, _COMPUTED)
            case ast.Return(value=ast.expr() as value) if not isinstance(value, ast.Constant):
                self._add(Place(node, "value", None), value, ast.Constant(None))
            case ast.Break():
                self._add(place, node, ast.Continue())
            case ast.Continue():
                self._add(place, node, ast.Break())
        if self._can_go(node):
            self._add(place, node, ast.Pass())
        self._children(node)

    def _function(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        # What an argument is by default is found when the function is made.
        for field in ("defaults", "kw_defaults"):
            for index, default in enumerate(getattr(node.args, field)):
                if default is not None:
                    self._within.append(node.name)
                    self._expression(Place(node.args, field, index), default)
                    self._within.pop()
        before = self._is_of_module, self._assigned
        self._is_of_module = False
        self._assigned = Counter(
            one.id
            for one in ast.walk(node)
            if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)
        )
        self._within.append(node.name)
        self._block(node, "body")
        self._within.pop()
        self._is_of_module, self._assigned = before

    def _can_go(self, node: ast.stmt) -> bool:
        """Whether it is a mistake to leave it out; not where nothing could be compiled or bound."""
        match node:
            case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Raise() | ast.Delete():
                return True
            case ast.Return(value=None):
                return True
            case ast.Assign(targets=targets):
                return any(self._stays_bound(target) for target in targets)
            case ast.AnnAssign(target=target, value=ast.expr()):
                return not self._is_of_module and self._stays_bound(target)
        return False

    def _stays_bound(self, target: ast.expr) -> bool:
        """A local name that is assigned once would not be bound: no test is needed to see that."""
        if isinstance(target, ast.Name):
            return self._assigned[target.id] > 1
        if isinstance(target, ast.Tuple):
            return all(self._stays_bound(one) for one in target.elts)
        return True

    def _children(self, node: ast.AST) -> None:
        for field, value in ast.iter_fields(node):
            if field in ("annotation", "returns", "decorator_list", "format_spec", "ctx"):
                continue
            if isinstance(value, ast.AST):
                self._child(Place(node, field, None), value)
            elif isinstance(value, list):
                if value and isinstance(value[0], ast.stmt):
                    self._block(node, field)
                    continue
                for index, one in enumerate(value):
                    if isinstance(one, ast.AST):
                        self._child(Place(node, field, index), one)

    def _child(self, place: Place, node: ast.AST) -> None:
        if isinstance(node, ast.ExceptHandler | ast.match_case):
            lines, self._lines = self._lines, range(_line(node), _line(node) + 1)
            self._children(node)
            self._lines = lines
        elif isinstance(node, ast.expr):
            self._expression(place, node)
        else:
            self._children(node)

    # --- expressions -------------------------------------------------------------------------

    def _expression(self, place: Place, node: ast.expr) -> None:
        match node:
            case ast.Constant(value=value):
                self._constant(place, node, value)
                return
            case ast.Compare(ops=ops):
                for index, operator in enumerate(ops):
                    self._operator(node, Place(node, "ops", index), operator, _COMPARED)
            case ast.BoolOp(op=operator, values=values):
                other = ast.Or() if isinstance(operator, ast.And) else ast.And()
                self._operation(node, Place(node, "op", None), operator, other)
                for index in range(len(values)):
                    left = values[:index] + values[index + 1 :]
                    one = left[0] if len(left) == 1 else ast.BoolOp(operator, left)
                    self._add(place, node, one)
            case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert(), operand=operand):
                self._add(place, node, operand)
            case ast.BinOp(op=operator, left=one, right=other) if not _are_words(one, other):
                self._operator(node, Place(node, "op", None), operator, _COMPUTED)
            case ast.IfExp(test=test):
                self._condition(Place(node, "test", None), test, (True, False))
            case ast.Call(func=ast.Name(id=name) as function) if name in _CALLED:
                self._add(Place(node, "func", None), function, ast.Name(_CALLED[name], ast.Load()))
            case ast.Call(func=ast.Attribute(attr=name) as method) if name in _CALLED:
                swapped = ast.Attribute(method.value, _CALLED[name], ast.Load())
                self._add(Place(node, "func", None), method, swapped)
        self._children(node)

    def _constant(self, place: Place, node: ast.Constant, value: object) -> None:
        match value:
            case bool():
                self._add(place, node, ast.Constant(not value))
            case int() | float():
                self._add(place, node, ast.Constant(value + 1))
            case str() if _FOR_PROGRAMS.fullmatch(value) and not _is_of_words(place):
                self._add(place, node, ast.Constant(f"{value}-other"))

    def _condition(self, place: Place, test: ast.expr, values: tuple[bool, ...]) -> None:
        if not isinstance(test, ast.Constant):
            for value in values:
                self._add(place, test, ast.Constant(value))

    def _operator(
        self,
        node: ast.AST,
        place: Place,
        operator: ast.AST,
        others: Mapping[Any, type[ast.AST]],
    ) -> None:
        other = others.get(type(operator))
        if other is not None:
            self._operation(node, place, operator, other())

    def _operation(self, node: ast.AST, place: Place, before: ast.AST, after: ast.AST) -> None:
        """A mistake of an operator is shown by the whole expression."""
        shown = ast.unparse(node)
        place.put(after)
        is_now = ast.unparse(node)
        place.put(before)
        self._note(place, before, after, shown, is_now, _line(node))

    def _add(self, place: Place, before: ast.AST, after: ast.AST) -> None:
        ast.copy_location(after, before)
        shown, is_now = ast.unparse(before), ast.unparse(after)
        self._note(place, before, ast.fix_missing_locations(after), shown, is_now, _line(before))

    def _note(
        self, place: Place, before: ast.AST, after: ast.AST, shown: str, is_now: str, line: int
    ) -> None:
        written = self._source[line - 1].strip()
        where = ".".join(self._within) or "module"
        name = f"{where} | {written} | {_short(shown)} -> {_short(is_now)}"
        self.found.append(Mutant(name, self._lines, self._is_of_module, place, before, after))


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN // 2]} ... {text[-_SHOWN // 2 :]}"


def _line(node: ast.AST) -> int:
    line: int = node.lineno if hasattr(node, "lineno") else node.pattern.lineno  # type: ignore[attr-defined]
    return line


def _last_line(node: ast.stmt) -> int:
    """Of what is run before the statements within it."""
    within = [
        one.lineno
        for field in ("body", "handlers", "cases")
        for one in getattr(node, field, ())[:1]
        if hasattr(one, "lineno")
    ]
    return max(node.lineno, min(within) - 1) if within else node.end_lineno or node.lineno


def _is_docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _is_for_types(test: ast.expr) -> bool:
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"


def _are_words(*operands: ast.expr) -> bool:
    """Whether texts are put together."""
    return any(
        isinstance(one, ast.JoinedStr)
        or (isinstance(one, ast.Constant) and isinstance(one.value, str))
        for one in operands
    )


def _is_of_words(place: Place) -> bool:
    return isinstance(place.parent, ast.JoinedStr)
