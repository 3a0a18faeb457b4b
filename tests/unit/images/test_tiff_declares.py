"""What a TIFF declares beside its samples: no data, a mask, an orientation, a scale, further pages."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from PIL import Image

from core import images

LUMA = np.array([0.2126, 0.7152, 0.0722])


def page(samples, **tags):
    """Return the tags and the bytes of a page: samples of shape (rows, columns) or (rows, columns, n), or packed."""
    values = np.atleast_3d(samples)
    rows, columns, count = values.shape
    kind = values.dtype.kind
    made = {
        "PageKind": (254, 4, [0]), "Width": (256, 4, [columns]), "Rows": (257, 4, [rows]),
        "Bits": (258, 3, [8 * values.dtype.itemsize] * count), "Compression": (259, 3, [1]),
        "Photometric": (262, 3, [1 if count < 3 else 2]), "Samples": (277, 3, [count]), "StripRows": (278, 4, [rows]),
        "SampleFormat": (339, 3, [{"u": 1, "i": 2, "f": 3}[kind]] * count),
    }  # fmt: skip
    numbers = {"Orientation": (274, 3), "Extra": (338, 3), "Gdal": (42112, 2), "NoData": (42113, 2)}
    body = tags.pop("packed", values.tobytes())
    for name, value in tags.items():
        tag, kind_ = made[name][:2] if name in made else numbers[name]
        made[name] = tag, kind_, value.encode() + b"\0" if isinstance(value, str) else [value]
    return sorted(made.values()), body


def tiff(*pages, big=False):
    """Return a file of pages, in the byte order '<'."""
    word, head = ("Q", "<2sHHHQ") if big else ("I", "<2sHI")
    out = bytearray(struct.pack(head, b"II", 43, 8, 0, 16) if big else struct.pack(head, b"II", 42, 8))
    for index, (entries, body) in enumerate(pages):
        entries = sorted([*entries, (273, 4, [0]), (279, 4, [len(body)])])
        size, inline = (20, 8) if big else (12, 4)
        at = len(out) + (8 if big else 2) + size * len(entries) + inline
        extra, table = bytearray(), bytearray()
        for tag, kind, values in entries:
            packed = values if kind == 2 else struct.pack(f"<{len(values)}{'HI'[kind == 4]}", *values)
            if tag == 273:
                packed = b"STRIP" + bytes(inline - 5) if big else b"STRP"
            table += struct.pack(f"<HH{word}", tag, kind, len(values))
            if len(packed) > inline:
                table += struct.pack(f"<{word}", at + len(extra))
                extra += packed + bytes(len(packed) % 2)
            else:
                table += packed.ljust(inline, b"\0")
        strip, end = at + len(extra), at + len(extra) + len(body)
        end += end % 2
        where = struct.pack(f"<{word}", strip)
        table = table.replace(b"STRIP" + bytes(inline - 5) if big else b"STRP", where)
        following = end if index + 1 < len(pages) else 0
        out += struct.pack("<Q" if big else "<H", len(entries)) + table + struct.pack(f"<{word}", following)
        out += extra + body
        out += bytes(end - len(out))
    return bytes(out)


@pytest.fixture
def read(tmp_path):
    def raster(data):
        (tmp_path / "map.tif").write_bytes(data)
        return images.read(tmp_path / "map.tif")

    return raster


def ramp(kind="u1"):
    return (100 + 7 * np.arange(5)[:, None] + np.arange(6)).astype(kind)


def codes(raster):
    return [(finding.code, finding.value) for finding in raster.findings]


def shown(raster):
    """Return stored numbers with the top row first."""
    return np.round(raster.values[::-1].astype(np.float64) * raster.largest, 2)


# Where the file's first row and first column are to be shown, from the format's own description.
TURNS = {
    1: lambda v: v,
    2: np.fliplr,
    3: lambda v: v[::-1, ::-1],
    4: np.flipud,
    5: np.transpose,
    6: lambda v: np.rot90(v, -1),
    7: lambda v: v[::-1, ::-1].T,
    8: lambda v: np.rot90(v, 1),
}


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("kind", ["u1", "u2", "i2", "f4", "f8"])
def test_the_orientation_turns_samples_and_not_their_bytes(read, turn, kind):
    values = ramp(kind)
    raster = read(tiff(page(values, Orientation=turn, NoData="107")))
    np.testing.assert_array_equal(shown(raster), TURNS[turn](values))
    np.testing.assert_array_equal(raster.holes[::-1], TURNS[turn](values == 107))


@pytest.mark.parametrize("turn", TURNS)
def test_the_orientation_turns_colours_and_masks(read, turn):
    colours = np.stack([ramp(), ramp() + 1, ramp() + 2], axis=2)
    there = ramp() % 3 > 0
    raster = read(tiff(page(colours, Orientation=turn), page(there.astype("u1") * 255, PageKind=4, Photometric=4)))
    np.testing.assert_allclose(raster.values[::-1], TURNS[turn](colours @ LUMA / 255), rtol=1e-6)
    np.testing.assert_array_equal(raster.holes[::-1], TURNS[turn](~there))


def test_a_colour_is_no_data_where_all_its_samples_are(read):
    colours = np.stack([ramp(), ramp(), ramp()], axis=2)
    colours[1, 2:4] = 0
    colours[3, 1] = 0, 0, 9  # a dark blue
    holes = read(tiff(page(colours, NoData="0"))).holes[::-1]
    assert holes[1, 2:4].all() and holes.sum() == 2


def test_no_data_beside_alpha_makes_holes_too(read):
    grey, alpha = ramp(), np.full((5, 6), 255, np.uint8)
    grey[0, 1], alpha[2, 2] = 0, 0
    holes = read(tiff(page(np.stack([grey, alpha], axis=2), Extra=2, NoData="0"))).holes[::-1]
    assert holes[0, 1] and holes[2, 2] and holes.sum() == 2


def test_no_data_of_a_jpeg_makes_holes(read):
    grey = np.full((16, 16), 120, np.uint8)
    grey[:, 8:] = 0  # a block of its own, which comes out as it went in
    stored = io.BytesIO()
    Image.fromarray(grey).save(stored, "TIFF", compression="jpeg", tiffinfo={42113: "0"})
    np.testing.assert_array_equal(read(stored.getvalue()).holes[::-1], grey == 0)


@pytest.mark.parametrize("photometric", [0, 1])
def test_no_data_of_few_bits_makes_holes(read, photometric):
    values = np.arange(32, dtype=np.uint8).reshape(4, 8) % 16
    packed = (values[:, ::2] << 4 | values[:, 1::2]).tobytes()
    raster = read(tiff(page(values, Bits=4, Photometric=photometric, packed=packed, NoData="3")))
    np.testing.assert_array_equal(raster.holes[::-1], values == 3)
    np.testing.assert_array_equal(shown(raster), values if photometric else 15 - values)


@pytest.mark.parametrize(("kind", "number"), [("u1", 255), ("u1", 0), ("u2", 65535)])
def test_no_data_is_the_stored_number_where_white_is_zero(read, kind, number):
    values = ramp(kind)
    values[2, 1:4] = number
    raster = read(tiff(page(values, Photometric=0, NoData=str(number))))
    np.testing.assert_array_equal(raster.holes[::-1], values == number)
    np.testing.assert_array_equal(shown(raster), np.iinfo(kind).max - values)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("bits", [1, 8])
def test_the_page_of_a_mask_makes_holes(read, bits, big):
    there = ramp() % 4 > 0
    packed = np.packbits(there, axis=1).tobytes() if bits == 1 else (there * np.uint8(255)).tobytes()
    mask = page(there.astype("u1"), Bits=bits, Photometric=4, PageKind=4, packed=packed)
    small = page(ramp()[::2, ::2], PageKind=1)
    small_mask = page(there[::2, ::2].astype("u1"), Photometric=4, PageKind=5)
    raster = read(tiff(page(ramp("f4")), small, mask, small_mask, big=big))
    np.testing.assert_array_equal(raster.holes[::-1], ~there)
    assert not raster.findings


def test_a_mask_that_is_not_read_is_told(read):
    raster = read(tiff(page(ramp("u2")), page(ramp()[:3], Photometric=4, PageKind=4)))
    assert codes(raster) == [("mask-not-read", "6 x 3")] and not raster.holes.any()
    raster = read(tiff(page(ramp("u2")), page(ramp("u2"), Photometric=4, PageKind=4)))
    assert codes(raster) == [("mask-not-read", "16 bit, compressed by method 1")]


def test_further_pages_and_a_scale_are_told(read):
    assert codes(read(tiff(page(ramp("u2")), page(ramp("u2")), page(ramp("u2"))))) == [("further-pages", "2")]
    gdal = '<GDALMetadata><Item name="OFFSET" sample="0" role="offset">-100</Item>'
    gdal += '<Item name="SCALE" sample="0" role="scale">0.1</Item></GDALMetadata>'
    assert codes(read(tiff(page(ramp("u2"), Gdal=gdal)))) == [
        ("scale-not-applied", "0.1"),
        ("offset-not-applied", "-100"),
    ]
    assert not codes(read(tiff(page(ramp("u2"), Gdal=gdal.replace("-100", "0").replace("0.1", "1")))))


def test_a_damaged_further_page_is_told_and_the_first_is_read(read):
    data = tiff(page(ramp("u2")), page(ramp("u2")))
    raster = read(data[:-100])
    assert codes(raster) == [("further-pages", "1")]
    np.testing.assert_array_equal(shown(raster), ramp("u2"))
