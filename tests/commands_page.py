"""The page `core/COMMANDS.md`: every verb of `python -m core`. `python3 build_addon.py docs` writes it anew."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from core.command_line.verbs import parser

PAGE = Path(__file__).resolve().parents[1] / "core" / "COMMANDS.md"
HEAD = """# Command line

`python3 build_addon.py docs` writes this page from the parser of `python -m core`; a test holds it current.

`python -m core` runs in the folder of the sources, `python -m dermis` anywhere after `pip install .`. Python and numpy
are enough for most verbs; skins and platforms also need scipy and threadpoolctl, learned thimbles onnxruntime, serial
ports pyserial, and PNG pictures Pillow. `FILE` is a scene that was sampled in Blender:

```
blender --command dermis sample scene.blend --out FILE
blender --command dermis render scene.blend --out DIR
```

The second command bakes and exports without this step. Three of its options have the names of options below, and
another meaning: `--format` writes a format instead of CSV (here: beside CSV); `--range` takes frames `FIRST:LAST`
(`export` here: seconds `FROM TO` of a track); `--presets` replaces the folder of your own presets.
`blender --command dermis render --help` lists all of its options.

Exit status: 0 on success, 1 when a finding has the severity *error*, 2 when the command was refused. With `--json` a
refusal is an object `error` on standard output, with a `code` that programs can compare.

A value in brackets at the end of a meaning is the default; (CSV), (HTML) and (JSON) are formats of files.
"""


def page() -> str:
    """Return the whole page."""
    verbs = list(_verbs(parser("core"), "", ""))
    lines = [HEAD, *(f"* [`{name}`](#{name.replace(' ', '-')}): {text}" for name, text, _ in verbs), ""]
    for name, text, verb in verbs:
        lines += [f"## {name}", "", f"{_sentence(verb.description or text)}", "", "```", _usage(name, verb), "```", ""]
        lines += [*_table(verb), ""]
        if verb.epilog:
            lines += [_sentence(" ".join(verb.epilog.split())), ""]
    return "\n".join(lines).rstrip() + "\n"


def _verbs(top: argparse.ArgumentParser, before: str, text: str) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    """Yield the name, summary and parser of each verb that does something, and of the verbs below it."""
    below = [a for a in top._actions if isinstance(a, argparse._SubParsersAction)]
    if before and (not below or not below[0].required):
        yield before, text, top
    for action in below:
        texts = {choice.dest: choice.help or "" for choice in action._choices_actions}
        for name, verb in action.choices.items():
            if name in texts and "not for people" not in texts[name]:
                yield from _verbs(verb, f"{before} {name}".strip(), texts[name])


def _usage(name: str, verb: argparse.ArgumentParser) -> str:
    words = [f"python -m core {name}"]
    for action in verb._actions:
        if not action.option_strings and not isinstance(action, argparse._SubParsersAction):
            word = _value(action)
            words.append(f"[{word}]" if action.nargs in ("?", "*") else word)
        elif action.required:
            words.append(f"{action.option_strings[-1]} {_value(action)}".strip())
    return " ".join([*words, "[OPTION ...]"])


def _value(action: argparse.Action) -> str:
    """Return the placeholders of an action's values, '' for a switch."""
    if action.nargs == 0:
        return ""
    names = action.metavar or ("|".join(map(str, action.choices)) if action.choices else action.dest.upper())
    if isinstance(names, tuple):
        return " ".join(names)
    if isinstance(action.nargs, int):
        return " ".join([names] * action.nargs)
    return f"{names} ..." if action.nargs in ("+", "*") else names


def _table(verb: argparse.ArgumentParser) -> list[str]:
    rows = ["| argument | meaning |", "|---|---|"]
    formatter = argparse.HelpFormatter(prog="core")
    for action in verb._actions:
        if action.help == argparse.SUPPRESS or isinstance(action, argparse._HelpAction | argparse._SubParsersAction):
            continue
        names = [f"`{' '.join(filter(None, (option, _value(action))))}`" for option in action.option_strings]
        text = " ".join(formatter._expand_help(action).split()) if action.help else ""
        rows.append(f"| {', '.join(names) or f'`{_value(action)}`'} | {text} |")
    return [_escaped(row) if k > 1 else row for k, row in enumerate(rows)] if len(rows) > 2 else []


def _escaped(row: str) -> str:
    """Escape the bars inside cells, which are those without spaces around them."""
    cells = row[2:-2].split(" | ")
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _sentence(text: str) -> str:
    text = " ".join(text.split())
    text = text[:1].upper() + text[1:]
    return text if text.endswith((".", ":", ")")) else f"{text}."


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else PAGE
    target.write_text(page(), encoding="utf-8", newline="\n")
