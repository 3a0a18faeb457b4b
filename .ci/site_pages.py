#!/usr/bin/env python3
"""Build the site of the documentation from the pages where they lie, with MkDocs; a warning is an error.

Pages, and every file that they link to or show, are copied to a folder of their own. Headings get the anchors that
the host of the sources gives them, so that one link serves both. Pages of boards are
found in their folders.
"""

from __future__ import annotations

import logging
import re
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
CONFIGURATION = Path(__file__).with_name("mkdocs.yml")
BOARDS = ("presets/boards/*.md", "presets/firmware/*/README.md")
NO_PAGES = {".git", ".venv", "node_modules", "bench_out", "build", "demo_out", "dist"}
LINK = re.compile(r"\]\(([^)\s]+)\)")
BLOCK, SPAN = re.compile(r"^```.*?^```", re.M | re.S), re.compile(r"`[^`\n]+`")  # of code


def pages() -> list[Path]:
    """Return all pages of the sources."""
    return [p for p in sorted(ROOT.rglob("*.md")) if p.relative_to(ROOT).parts[0] not in NO_PAGES]


def anchors(text: str) -> list[str]:
    """Return the anchors of a page's headings, as the host of the sources makes them."""
    seen: Counter[str] = Counter()
    found = []
    for heading in re.findall(r"^#+ +(.+?) *$", BLOCK.sub("", text), re.M):
        name = slug(re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading), "-")
        found.append(f"{name}-{seen[name]}" if seen[name] else name)
        seen[name] += 1
    return found


def slug(heading: str, separator: str) -> str:
    """Return a heading's anchor: lower case, letters, digits and hyphens, a hyphen for each space."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", separator)


def links(text: str) -> list[str]:
    """Return the targets of a page's links and pictures, those in code left out."""
    return LINK.findall(SPAN.sub("", BLOCK.sub("", text)))


def broken(page: Path) -> list[str]:
    """Return the links of a page that lead nowhere: to a missing file or heading."""
    text, out = page.read_text(encoding="utf-8"), []
    for link in links(text):
        name, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:", link):
            continue
        target = page.parent / name if name else page
        if not target.exists():
            out.append(link)
        elif anchor and (target.suffix != ".md" or anchor not in anchors(target.read_text(encoding="utf-8"))):
            out.append(link)
    return out


def copied(folder: Path) -> None:
    """Copy the pages and the files that they name; a repeated heading's anchor ends as MkDocs ends it."""
    for page in pages():
        text = page.read_text(encoding="utf-8")
        for link in links(text):
            file = (page.parent / link.partition("#")[0]).resolve()
            if file.is_file() and file.suffix != ".md" and ROOT in file.parents:
                target = folder / file.relative_to(ROOT)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, target)
        target = folder / page.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        repeated = {
            name for name in anchors(text) if re.search(r"-\d+$", name) and name.rpartition("-")[0] in anchors(text)
        }
        for name in repeated:
            text = text.replace(f"](#{name})", f"](#{'_'.join(name.rsplit('-', 1))})")
        target.write_text(text, encoding="utf-8")


def build(site: Path) -> int:
    """Build the site; return the number of warnings."""
    from mkdocs.commands.build import build as build_site
    from mkdocs.config import load_config

    warned = Warned()
    logging.getLogger("mkdocs").addHandler(warned)
    with tempfile.TemporaryDirectory(prefix="dermis-site-") as scratch:
        copied(Path(scratch))
        config: Any = load_config(str(CONFIGURATION), docs_dir=scratch, site_dir=str(site.resolve()))
        config.mdx_configs.setdefault("toc", {})["slugify"] = slug
        boards = sorted({p.relative_to(scratch).as_posix() for kind in BOARDS for p in Path(scratch).glob(kind)})
        (entry,) = (entry for entry in config.nav if "Hardware" in entry)
        entry["Hardware"] += boards
        config.plugins.on_startup(command="build", dirty=False)
        build_site(config)
    return warned.count


class Warned(logging.Handler):
    """Prints and counts warnings."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.count = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Print and count one."""
        self.count += 1
        print(f"{record.levelname}: {record.getMessage()}")


if __name__ == "__main__":
    count = build(Path(sys.argv[1]))
    print(f"{count} warnings" if count else "no warnings")
    sys.exit(1 if count else 0)
