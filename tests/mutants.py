"""What a mutation changes in a source: one operator, constant, call or bound, and nothing that only people read."""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass

TINY = 1e-5  # a float below this is a tolerance: twice as much is the same tolerance, a thousand times is another

Operator = ast.operator | ast.boolop | ast.unaryop | ast.cmpop
BINARY: dict[type, type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.BitXor: ast.BitAnd,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift,
}  # fmt: skip
COMPARE: dict[type, tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}  # fmt: skip
PAIRS = ("min max", "minimum maximum", "argmin argmax", "any all", "floor ceil", "sin cos", "floor_divide true_divide")
NAMES = {a: b for pair in PAIRS for a, b in (pair.split(), pair.split()[::-1])}
MESSAGES = {"DermisError", "Finding", "warn", "print"}  # calls that hold words for people, and numbers for those words
WORDS = {"where", "limit", "remedy", "axis", "keepdims", "indent", "stacklevel"}  # arguments that no test should pin


@dataclass(frozen=True)
class Mutation:
    """One change of one file.

    Attributes:
        path: of the file below the root. line: of the change.
        start, end: bytes of the node that is replaced. text: what stands there instead.
        what: the change in words.
    """

    path: str
    line: int
    start: int
    end: int
    text: str
    what: str

    def applied(self, source: bytes) -> bytes:
        """Return the file with this change."""
        return source[: self.start] + self.text.encode() + source[self.end :]


def mutations(path: str, source: bytes) -> list[Mutation]:
    """Return every change of a file, in the order of its text."""
    lines, starts = source.splitlines(keepends=True), [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    found = []
    for node in _nodes(ast.parse(source)):
        if not isinstance(node, ast.expr | ast.stmt):
            continue
        assert node.end_lineno is not None and node.end_col_offset is not None
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        for what, new in _variants(node):
            plain = isinstance(new, ast.stmt | ast.Slice | ast.Constant | ast.Attribute | ast.Name)
            text = ast.unparse(ast.fix_missing_locations(new))
            shown = source[start:end] if end - start > 12 else lines[node.lineno - 1]
            where = " ".join(shown.decode().split())
            told = f"{what}  in  {where[:90]}{' ...' if len(where) > 90 else ''}"
            found.append(Mutation(path, node.lineno, start, end, text if plain else f"({text})", told))
    return sorted(found, key=lambda m: (m.start, m.end, m.text))


def _nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that may change: no types, no messages, nothing that only a reader of a traceback sees."""
    if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom):
        return
    if isinstance(node, ast.Call) and _name(node.func) in MESSAGES | {"reshape"}:  # numpy takes -2 for -1 there
        return
    if isinstance(node, ast.If) and _name(node.test) in ("TYPE_CHECKING", "__name__"):
        return
    if isinstance(node, ast.FunctionDef) and node.name in ("__repr__", "__str__"):
        return
    if isinstance(node, ast.Assign) and any(_name(t) == "__all__" for t in node.targets):
        return
    if isinstance(node, ast.keyword) and node.arg in WORDS:
        return
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "bases", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _nodes(child)


def _variants(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield what may stand in a node's place, and what that changes."""
    if isinstance(node, ast.BinOp) and type(node.op) in BINARY and not _is_text_or_type(node):
        yield from _with_op(node, node.op, BINARY[type(node.op)]())
    elif isinstance(node, ast.AugAssign) and type(node.op) in BINARY and not _is_text_or_type(node):
        yield from _with_op(node, node.op, BINARY[type(node.op)]())
    elif isinstance(node, ast.BoolOp):
        yield from _with_op(node, node.op, ast.Or() if isinstance(node.op, ast.And) else ast.And())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub | ast.Invert):
        yield f"{_symbol(node.op)} removed", node.operand
    elif isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            for other in COMPARE[type(op)]:
                yield (
                    f"{_symbol(op)} -> {_symbol(other())}",
                    _but(node, ops=[*node.ops[:i], other(), *node.ops[i + 1 :]]),
                )
    elif isinstance(node, ast.Constant):
        yield from _numbers(node)
    elif isinstance(node, ast.Attribute | ast.Name) and _name(node) in NAMES and isinstance(node.ctx, ast.Load):
        other_name = NAMES[_name(node)]
        field = {"attr": other_name} if isinstance(node, ast.Attribute) else {"id": other_name}
        yield f"{_name(node)} -> {other_name}", _but(node, **field)
    elif isinstance(node, ast.Slice):
        yield from _slices(node)
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield "call removed", ast.Pass()
    elif isinstance(node, ast.Continue):
        yield "continue -> break", ast.Break()


def _numbers(node: ast.Constant) -> Iterator[tuple[str, ast.AST]]:
    value, other = node.value, node.value
    if isinstance(value, bool):
        other = not value
    elif isinstance(value, int):
        other = value + 1
    elif isinstance(value, float):
        other = 1.0 if value == 0.0 else value * (1e3 if abs(value) < TINY else 2.0)
    if other is not value:
        yield f"{value!r} -> {other!r}", ast.Constant(other)


def _slices(node: ast.Slice) -> Iterator[tuple[str, ast.AST]]:
    """Shorten a slice by one at either end; bounds that are numbers change as numbers do."""
    one = ast.Constant(1)
    if node.lower is not None and not isinstance(node.lower, ast.Constant):
        yield "begins one later", _but(node, lower=ast.BinOp(node.lower, ast.Add(), one))
    if node.upper is not None and not isinstance(node.upper, ast.Constant):
        yield "ends one earlier", _but(node, upper=ast.BinOp(node.upper, ast.Sub(), one))
    if (node.lower is None) != (node.upper is None) and node.step is None:
        if node.lower is None:
            yield "begins one later", _but(node, lower=one)
        else:
            yield "ends one earlier", _but(node, upper=ast.UnaryOp(ast.USub(), one))


def _with_op(node: ast.AST, op: Operator, other: Operator) -> Iterator[tuple[str, ast.AST]]:
    yield f"{_symbol(op)} -> {_symbol(other)}", _but(node, op=other)


def _but(node: ast.AST, **fields: object) -> ast.AST:
    """Return a copy of a node with other fields."""
    other = copy.copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other


def _is_text_or_type(node: ast.BinOp | ast.AugAssign) -> bool:
    """Return whether an operator joins strings, or the types of a union."""
    sides = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.value]
    if any(isinstance(s, ast.JoinedStr) or (isinstance(s, ast.Constant) and isinstance(s.value, str)) for s in sides):
        return True
    types = ("None", "int", "float", "str", "bool", "bytes", "list", "dict", "tuple", "slice")
    return isinstance(node.op, ast.BitOr) and any(
        _name(s)[:1].isupper() and not _name(s).isupper() or ast.unparse(s) in types for s in sides
    )


def _symbol(op: Operator) -> str:
    """Return an operator as it is written."""
    a, b = ast.Name("a"), ast.Name("b")
    node: ast.expr
    if isinstance(op, ast.unaryop):
        return ast.unparse(ast.UnaryOp(op, a)).rstrip("a").strip()
    if isinstance(op, ast.cmpop):
        node = ast.Compare(a, [op], [b])
    else:
        node = ast.BoolOp(op, [a, b]) if isinstance(op, ast.boolop) else ast.BinOp(a, op, b)
    return ast.unparse(node)[1:-1].strip()


def _name(node: ast.AST | None) -> str:
    """Return the last part of a dotted name, '' of anything else."""
    if isinstance(node, ast.Compare):
        node = node.left
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
