"""Damage for files of every kind that is read, out of one seed: bytes anywhere, and what each format means by them."""

from __future__ import annotations

import ast
import copy
import io
import json
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable
from typing import Any

DEEP = 1500
STRANGE: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1,
    3,
    0.5,
    -0.5,
    1e-320,
    1e308,
    -1e308,
    float("nan"),
    float("inf"),
    -float("inf"),
    2**31,
    2**63,
    -(2**63) - 1,
    10**400,
    -(10**400),
    "",
    "x",
    "nan",
    "1e999",
    "\ud800",
    "a\0b",
    "\u202e",
    "../..",
    "é" * 300,
    "a" * 20_000,
    [],
    {},
    [[]],
    [0],
    [1, 2, 3],
    [None],
    ["a", "b"],
    [[1, 2], [3]],
    {"a": 1},
    {"value": 1},
    {"value": [], "unit": "m"},
    {"value": 1, "unit": {}},
    {"value": [[[1]]], "unit": "mm"},
    {"": 0},
    {"repeat": 4096},
)
NUMBERS = (
    b"nan",
    b"inf",
    b"-inf",
    b"1e999",
    b"-1",
    b"0",
    b"1e-320",
    b"9" * 400,
    b"9" * 5000,
    b"0x10",
    b"1_000",
    b"",
    b" ",
    b"1e",
    b"--1",
    b"\xff",
    b"\xd9\xa1",
    b"1.5.5",
    b"99999999999999999999",
)
BYTES = (
    b"\0",
    b"\xff",
    b"\n",
    b"\r\n",
    b"\x1a",
    b",",
    b'"',
    b"{",
    b"[",
    b"]",
    b"}",
    b"\\",
    b"#",
    b"\xed\xa0\x80",
    b"\xef\xbb\xbf",
    b"\0" * 64,
    b"[" * DEEP,
    b'{"a":' * DEEP,
    b"\xff" * 16,
    b"(" * DEEP,
)
SHAPES = (
    "()",
    "(0,)",
    "(-1,)",
    "(1,)",
    "(4000000000,)",
    "(3, 4000000000)",
    "(4000000000, 0)",
    "(0, 3)",
    "(0, 2)",
    "(2, 2)",
    "(4611686018427387904, 4611686018427387904)",
    "(1,) * 3",
    "(1.5,)",
    "(True,)",
    "None",
    "[3]",
    "3",
    "('a',)",
    f"({'1, ' * 70})",
    f"{'(' * 90}1{')' * 90}",
    f"(10{'0' * 400},)",
    "(1 << 40,)",
    "(9, 3)",
    "(1, 9, 3)",
)
DESCRS = (
    "'<f8'",
    "'>f8'",
    "'<f4'",
    "'<f2'",
    "'<i4'",
    "'|u1'",
    "'|b1'",
    "'<c16'",
    "'|O'",
    "'O'",
    "'<U1'",
    "'<U100000000'",
    "'|S0'",
    "'|V0'",
    "'|V8'",
    "'<M8[s]'",
    "'<m8[ns]'",
    "'<M8[2000000000s]'",
    "'x'",
    "''",
    "None",
    "8",
    "[('a', '<f8')]",
    "[('a', '<f8', (4000000000,))]",
    "[]",
    "'<f8, <f8'",
    "{'names': ['a']}",
    "'<i99999999999'",
)
HEADERS = (
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }",
    b"{",
    b"((((((((",
    b"{'descr': '<f8'}",
    b"",
    b"\0" * 40,
    b"'''",
    b"  x\n y",
    b"\xff\xfe",
    b"{'shape': (1L, 2L), 'descr': '<f8', 'fortran_order': False}",
    b"1" * 6000,
    b"{'descr': '<f8', 'fortran_order': 3, 'shape': (1,)}",
    b"-" * 3000 + b"1",
    b"lambda: 0",
    b"{**{}}",
    b"[" * 3000,
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (1,), 'x': 0}",
    b"0777",
    b"if 1:\n\tx\n        y",
    b"'\\x",
)


class Damager:
    """Makes damaged versions of whole files; the same seed makes the same.

    Args:
        seed: of the random choices.
    """

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)

    def damage(self, data: bytes) -> bytes:
        """Return a file with one to three injuries: of its format where there is one that is known, or of its bytes."""
        for _ in range(self.rng.choice((1, 1, 1, 2, 3))):
            by_format = self._by_format(data)
            try:
                data = self.bytes(data) if by_format is None or self.rng.random() < 0.35 else by_format(data)
            except Exception:  # an earlier injury left nothing of the format; zip readers have many words for that
                data = self.bytes(data)
        return data

    def _by_format(self, data: bytes) -> Callable[[bytes], bytes] | None:
        if data.startswith(b"PK"):
            return self.archive
        if data.startswith(b"\x93NUMPY"):
            return self.array
        if data.startswith(b"\x89PNG"):
            return self.png
        if data.startswith(b"\x89DRMT"):
            return self.track
        if data[:1] == b"{":
            return self.json
        if data[:1] == b"\0" and data[-1:] == b"\0":
            return self.frame
        if b"dermis-surrogate" in data:
            return self.metadata
        if data[:2] in (b"P2", b"P3", b"P5", b"P6", b"Pf", b"PF") or b"," in data[:300]:
            return self.text
        return None

    # -- any file

    def bytes(self, data: bytes) -> bytes:
        """Flip, cut, insert, repeat or replace."""
        rng, n = self.rng, len(data)
        at = rng.randrange(n + 1)
        end = min(at + rng.choice((1, 2, 4, 16, 200)), n)
        kind = rng.randrange(8)
        if kind <= 1 and n:
            at = min(at, n - 1)
            return data[:at] + bytes((data[at] ^ 1 << rng.randrange(8),)) + data[at + 1 :]
        if kind == 2:
            return data[:at]
        if kind == 3:
            return data[:at] + rng.choice(BYTES) + data[at:]
        if kind == 4:
            return data[:at] + data[end:]
        if kind == 5:
            return data[:end] + data[at:end] * rng.choice((1, 3, 50)) + data[end:]
        if kind == 6:
            return data[:at] + rng.randbytes(end - at) + data[end:]
        return data[:at] + rng.choice(BYTES) + data[end:]

    def text(self, data: bytes) -> bytes:
        """Change a word of a text, a line of it, or the JSON behind a header's colon."""
        rng = self.rng
        lines = data.split(b"\n")
        i = rng.randrange(len(lines))
        kind = rng.randrange(6)
        if kind == 0:
            del lines[i]
        elif kind == 1:
            lines.insert(i, rng.choice(lines))
        elif lines[i].startswith(b"#") and b": " in lines[i] and kind < 5:
            key, _, value = lines[i].partition(b": ")
            if value[:1] in b'{["' and kind != 2:
                value = self.json(value)
            else:
                value = rng.choice((*NUMBERS, _text(rng.choice(STRANGE))))
            lines[i] = key + b": " + value
        else:
            words = re.split(rb"([,;\t :]+)", lines[i])
            k = rng.randrange(len(words))
            words[k] = rng.choice((*NUMBERS, words[rng.randrange(len(words))]))
            lines[i] = b"".join(words)
        return b"\n".join(lines)

    def json(self, data: bytes) -> bytes:
        """Change a value of a JSON text to one of another kind, drop it, double it or bury it."""
        return _text(self._value(json.loads(data)), self.rng)

    def _value(self, value: Any) -> Any:
        rng = self.rng
        places = list(_places(value))
        if not places:
            return copy.deepcopy(rng.choice(STRANGE))
        container, key = rng.choice(places)
        kind = rng.randrange(10)
        if kind < 6:
            container[key] = copy.deepcopy(rng.choice(STRANGE))
        elif kind == 6:
            del container[key]
        elif kind == 7:
            other, where = rng.choice(places)
            container[key], other[where] = other[where], container[key]
        elif kind == 8:
            container[key] = [container[key]]
        elif isinstance(container, dict):
            name = rng.choice(("x", "", "\ud800", "schema", "name", "0", "repeat"))
            container[name] = copy.deepcopy(rng.choice(STRANGE))
        else:
            container.extend(container[:] * rng.choice((1, 30)))
        return value

    # -- numpy, zip, PNG, and this product's own

    def array(self, data: bytes) -> bytes:
        """Change the header of a .npy, or its data."""
        rng = self.rng
        size = struct.unpack_from("<H", data, 8)[0]
        header, body = data[10 : 10 + size], data[10 + size :]
        kind = rng.randrange(6)
        if kind == 5:
            return data[: 10 + size] + self.bytes(body)
        if kind == 4:
            header = rng.choice(HEADERS)
        else:
            found = ast.literal_eval(header.decode("latin-1").strip())
            parts = {k: repr(v) for k, v in found.items()}
            if kind != 1:
                parts["shape"] = rng.choice(SHAPES)
            if kind:
                parts["descr"] = rng.choice(DESCRS)
            if rng.random() < 0.2:
                parts["fortran_order"] = rng.choice(("True", "1", "'x'"))
            header = ("{" + ", ".join(f"'{k}': {v}" for k, v in parts.items()) + "}\n").encode()
        version = rng.choice(((1, 0),) * 6 + ((2, 0), (3, 0), (9, 9)))
        length = struct.pack("<H" if version[0] == 1 else "<I", min(len(header), 65535))
        return b"\x93NUMPY" + bytes(version) + length + header + body

    def archive(self, data: bytes) -> bytes:
        """Rename, remove, double, compress or change members of a zip."""
        rng = self.rng
        with zipfile.ZipFile(io.BytesIO(data)) as found:
            members = [[info.filename, found.read(info)] for info in found.infolist()]
        i, kind = rng.randrange(len(members)), rng.randrange(12)
        if kind > 8:  # what there is in words, where there is some
            i = next((k for k, (_, content) in enumerate(members) if b'{"' in content or b"{\n" in content), i)
        name, content = members[i]
        packing = zipfile.ZIP_STORED
        if kind == 0:
            members[i][0] = rng.choice(("", "x", "../x.npy", name.removesuffix(".npy"), "header.npy", "\ud7ff.npy"))
        elif kind == 1:
            del members[i]
        elif kind == 2:
            members.append([name, rng.choice(members)[1]])
        elif kind == 3:
            members[i][1] = rng.choice(members)[1]
        elif kind == 4:
            packing = rng.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA))
        else:
            members[i][1] = self._member(content)
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", packing) as made:
            for name, content in members:
                made.writestr(zipfile.ZipInfo(name or "empty"), content, packing)
        whole = packed.getvalue()
        if rng.random() < 0.15:  # fields of the directory: method, flags, sizes
            at = whole.rfind(b"PK\1\2")
            at += rng.choice((8, 10, 16, 20, 24, 28, 42))
            whole = whole[:at] + rng.randbytes(rng.choice((1, 2))) + whole[at + 2 :]
        return whole

    def _member(self, content: bytes) -> bytes:
        """Change a member: JSON, or an array, which may hold a JSON text in its bytes."""
        if content[:1] == b"{":
            return self.json(content)
        if not content.startswith(b"\x93NUMPY"):
            return self.bytes(content)
        size = struct.unpack_from("<H", content, 8)[0]
        body = content[10 + size :]
        if body[:1] != b"{" or self.rng.random() < 0.2:
            return self.array(content)
        text = self.json(body)
        header = f"{{'descr': '|u1', 'fortran_order': False, 'shape': ({len(text)},), }}\n".encode()
        return b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header + text

    def png(self, data: bytes) -> bytes:
        """Change a chunk and mend its check sum, or the order of the chunks."""
        rng = self.rng
        chunks, at = [], 8
        while at < len(data):
            (length,) = struct.unpack_from(">I", data, at)
            chunks.append([data[at + 4 : at + 8], data[at + 8 : at + 8 + length]])
            at += length + 12
        i = rng.randrange(len(chunks))
        kind = rng.randrange(6)
        if kind == 0:
            del chunks[i]
        elif kind == 1:
            chunks.insert(i, rng.choice(chunks))
        elif kind == 2:
            chunks[i][0] = rng.choice((b"IHDR", b"IDAT", b"PLTE", b"tRNS", b"IEND", b"XXXX", b"\0\0\0\0", b"abCd"))
        elif kind == 3:
            sizes = struct.pack(">II", *(rng.choice((0, 1, 2, 9, 4096, 65535, 2**31 - 1, 2**32 - 1)) for _ in "xy"))
            chunks[0][1] = sizes + chunks[0][1][8:]
        elif kind == 4:
            body = zlib.decompress(b"".join(c[1] for c in chunks if c[0] == b"IDAT"))
            chunks = [c for c in chunks if c[0] != b"IDAT"]
            chunks.insert(-1, [b"IDAT", zlib.compress(self.bytes(body))])
        else:
            chunks[i][1] = self.bytes(chunks[i][1])
        return data[:8] + b"".join(
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
            for name, body in chunks
        )

    def track(self, data: bytes) -> bytes:
        """Change a binary track and mend its check sum."""
        size = struct.unpack_from("<I", data, 8)[0]
        text, body = data[12 : 12 + size], data[12 + size : -4]
        if self.rng.random() < 0.7:
            text = self.json(text)
        else:
            body = self.bytes(body)
        size = len(text) if self.rng.random() < 0.9 else self.rng.choice((0, 1, 2**31, 2**32 - 1))
        whole = data[:8] + struct.pack("<I", size) + text + body
        return whole + struct.pack("<I", zlib.crc32(whole))

    def frame(self, data: bytes) -> bytes:
        """Change the body of a packet of the native protocol and mend its check sum."""
        from core.stream.protocols import packets

        found = packets.Decoder().feed(data)
        if not found:
            return self.bytes(data)
        one = self.rng.choice(found)
        kind = self.rng.choice((one.kind, *packets.Kind, 0, 255))
        return packets.pack(kind, one.session, one.sequence, self.bytes(one.body)[:3000])

    def metadata(self, data: bytes) -> bytes:
        """Change the JSON at the end of an ONNX file of ours, its length with it."""
        at = data.rfind(b'{"')
        text = self.json(data[at:])
        head = data[:at]
        tag = head.rfind(b"\x72")  # field 14, a message
        return head[:tag] + _part(14, _part(1, b"dermis") + _part(2, text))


def _part(field: int, data: bytes) -> bytes:
    def number(n: int) -> bytes:
        out = bytearray()
        while n > 0x7F:
            out.append(n & 0x7F | 0x80)
            n >>= 7
        return bytes(out) + bytes((n,))

    return number(field << 3 | 2) + number(len(data)) + data


def _places(value: Any) -> Iterable[tuple[Any, Any]]:
    """Return every place in a JSON value: its container and its key there."""
    todo = [value] if isinstance(value, dict | list) else []
    while todo:
        container = todo.pop()
        items = list(container.items()) if isinstance(container, dict) else list(enumerate(container))
        for key, inner in items:
            yield container, key
            if isinstance(inner, dict | list):
                todo.append(inner)


def _text(value: Any, rng: random.Random | None = None) -> bytes:
    """Write JSON in some form that JSON readers take, wrong constants and halves of characters included."""
    text = json.dumps(value, ensure_ascii=rng is None or rng.random() < 0.8)
    if rng is not None and rng.random() < 0.03:
        deep = rng.choice(("[", '{"a":'))
        text = text.replace("1", deep * rng.choice((40, DEEP)), 1)
    return text.encode("utf-8", "surrogatepass")
