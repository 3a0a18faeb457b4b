#!/usr/bin/env python3
"""Write core/API.md from the docstrings of what `core/__init__.py` makes public; reads the sources, imports nothing."""

from __future__ import annotations

import ast
import re
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
CORE = ROOT / "core"
SECTION = re.compile(r"(Args|Attributes|Returns|Raises|Source):(.*)")
HEAD = """\
<!-- Written by `python3 build_addon.py docs` from the docstrings; a test holds it to them. Edit those. -->

# What `import dermis` offers
"""


class Source(NamedTuple):
    """A file, its lines and its syntax."""

    path: Path
    lines: list[str]
    tree: ast.Module

    def named(self, name: str) -> ast.ClassDef | ast.FunctionDef:
        """Return a class or function of the file."""
        return next(n for n in self.tree.body if isinstance(n, ast.ClassDef | ast.FunctionDef) and n.name == name)

    def head(self, node: ast.ClassDef | ast.FunctionDef) -> str:
        """Return a definition's head as it stands in the file, decorators and colon left out."""
        return textwrap.dedent("\n".join(self.lines[node.lineno - 1 : node.body[0].lineno - 1])).rstrip().rstrip(":")

    def origin(self, name: str) -> Source | None:
        """Return the file of the engine that a name is imported from."""
        for node in self.tree.body:
            if isinstance(node, ast.ImportFrom) and node.level and name in [a.name for a in node.names]:
                return source(self.path.parents[node.level - 1].joinpath(*(node.module or "").split(".")))
        return None


def source(stem: Path) -> Source:
    """Read a module by its path without suffix."""
    path = stem.with_suffix(".py") if stem.with_suffix(".py").is_file() else stem / "__init__.py"
    text = path.read_text(encoding="utf-8")
    return Source(path, text.splitlines(), ast.parse(text))


def page() -> str:
    """Return the page: the package's docstring, tables of the names by group, then each name, signature first."""
    package = source(CORE)
    groups = list(public(package))
    out = [HEAD, *prose(ast.get_docstring(package.tree) or ""), ""]
    anchors: Counter[str] = Counter()
    for title, names in groups:
        out += ["", f"| {title} | |", "|---|---|"]
        for name, module, attribute in names:
            again = anchors[name.lower()]  # headings that differ by case only are numbered
            anchor = f"{name.lower()}-{again}" if again else name.lower()
            anchors[name.lower()] += 1
            text = ast.get_docstring(source(CORE.joinpath(*module.split("."))).named(attribute)) or ""
            out.append(f"| [`{name}`](#{anchor}) | {summary(text)} |")
    for title, names in groups:
        out += ["", f"## {title}"]
        for name, module, attribute in names:
            out += ["", f"### {name}", "", *described(source(CORE.joinpath(*module.split("."))), attribute, name)]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(out)) + "\n"


def public(package: Source) -> Iterator[tuple[str, list[tuple[str, str, str]]]]:
    """Yield the groups of `_PUBLIC`: the comment above, and name, module and name there of each entry."""
    start = next(i for i, line in enumerate(package.lines) if line.startswith("_PUBLIC"))
    title = ""
    names: list[tuple[str, str, str]] = []
    for line in package.lines[start + 1 :]:
        if line.startswith("    #") or line == "}":
            if names:
                yield title, names
            title = line.strip(" #")
            title, names = title[:1].upper() + title[1:], []
        if line == "}":
            return
        if found := re.findall(r'"([^"]+)"', line):
            names.append((found[0], found[1], found[2]))


def described(file: Source, attribute: str, name: str) -> list[str]:
    """Return what the page says of a class or function; `name` is what the package calls it."""
    node = file.named(attribute)
    if isinstance(node, ast.FunctionDef):
        return [*code(file.head(node).replace(f"def {attribute}(", f"dermis.{name}(", 1)), *doc(node)]
    out = [*code(constructor(file, node)), *doc(node)]
    for at, member in members(file, node):
        decorators = {ast.unparse(d) for d in member.decorator_list}
        if decorators & {"property", "cached_property"}:
            out += [f"* `.{member.name}`: {summary(ast.get_docstring(member) or '')}"]
        else:
            owner = name if "classmethod" in decorators else ""
            head = re.sub(r"\b(self|cls)(, |(?=\)))", "", at.head(member), count=1)
            out += ["", *code(head.replace("def ", f"{owner}.", 1)), *doc(member)]
    return out


def constructor(file: Source, node: ast.ClassDef) -> str:
    """Return how a thing of a class is made: what `__init__` takes, or its fields, those of its bases first."""
    fields: list[str] = []
    for at, one in reversed(list(family(file, node))):
        for member in one.body:
            if isinstance(member, ast.FunctionDef) and member.name == "__init__":
                taken_by = re.sub(r"self(, |(?=\)))", "", at.head(member), count=1)
                return taken_by.replace("def __init__(", f"class {node.name}(", 1).removesuffix(" -> None")
            if isinstance(member, ast.AnnAssign) and not ast.unparse(member.target).startswith("_"):
                fields += at.lines[member.lineno - 1 : member.end_lineno]
    return "\n".join([file.head(node) + ":", *fields])


def members(file: Source, node: ast.ClassDef) -> Iterator[tuple[Source, ast.FunctionDef]]:
    """Yield a class's public methods and properties with their file, those of its bases after them."""
    for at, one in family(file, node):
        for member in one.body:
            if isinstance(member, ast.FunctionDef) and not member.name.startswith("_"):
                yield at, member


def family(file: Source, node: ast.ClassDef) -> Iterator[tuple[Source, ast.ClassDef]]:
    """Yield a class and its bases in the engine, each with its file."""
    yield file, node
    for name in map(ast.unparse, node.bases):
        origin = file.origin(name)
        base = origin and origin.named(name)
        if origin and isinstance(base, ast.ClassDef):
            yield from family(origin, base)


def summary(text: str) -> str:
    """Return a docstring's first paragraph on one line."""
    return " ".join(text.partition("\n\n")[0].split())


def code(text: str) -> list[str]:
    """Return text as a block of Python."""
    return ["```python", text, "```", ""]


def doc(node: ast.ClassDef | ast.FunctionDef) -> list[str]:
    """Return a definition's docstring as Markdown."""
    return [*prose(ast.get_docstring(node) or ""), ""]


def prose(text: str) -> list[str]:
    """Return a docstring as Markdown: sections with a list each, and doctests and indented blocks as code."""
    out: list[str] = []
    lines = text.splitlines()
    while lines:
        section = SECTION.fullmatch(lines[0])
        if lines[0].startswith(">>> "):
            block = taken(lines, bool)
            out += ["```python", *block, "```"]
        elif section and section[1] != "Source":
            lines.pop(0)
            block = taken(lines, lambda line: line.startswith(" ") or not line)
            entries = textwrap.dedent("\n".join(block)).strip().splitlines()
            out += [f"**{section[1]}**{section[2] and ':'}{section[2]}", ""]
            out += [entry if entry.startswith(" ") else f"* {entry}" for entry in entries] + [""]
        elif lines[0].startswith("    "):
            block = taken(lines, lambda line: line.startswith(" ") or not line)
            out += ["```python", *textwrap.dedent("\n".join(block)).strip().splitlines(), "```", ""]
        else:
            out.append(re.sub(r"::$", ":", lines.pop(0)))
    while out and not out[-1]:
        out.pop()
    return out


def taken(lines: list[str], wanted: Callable[[str], bool]) -> list[str]:
    """Take lines from the front while they are wanted."""
    block = []
    while lines and wanted(lines[0]):
        block.append(lines.pop(0))
    return block


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else CORE / "API.md"
    target.write_text(page(), encoding="utf-8", newline="\n")
