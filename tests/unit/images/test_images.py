"""Height images of every kind, against maps that are known exactly."""

from __future__ import annotations

import itertools
import struct
import zlib

import numpy as np
import pytest

from core import images
from core.effects.depth_map import read
from core.errors import DermisError

# --- a PNG writer from the format's own description, one byte at a time


def paeth(left, up, corner):
    guess = left + up - corner
    return min((abs(guess - left), 0, left), (abs(guess - up), 1, up), (abs(guess - corner), 2, corner))[2]


def filtered(rows, kinds, step):
    out, above = b"", bytes(len(rows[0]))
    for row, kind in zip(rows, kinds, strict=True):
        left = bytes(step) + row
        corner = bytes(step) + above
        guesses = [
            (0, left[i], above[i], (left[i] + above[i]) // 2, paeth(left[i], above[i], corner[i]))[kind]
            for i in range(len(row))
        ]
        out += bytes([kind]) + bytes((b - g) % 256 for b, g in zip(row, guesses, strict=True))
        above = row
    return out


def chunk(name, body):
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png(samples, depth, colour, kinds=None, extra=b"", interlace=0):
    """Encode whole numbers of shape (rows, columns, channels), the first row at the top."""
    rows, columns, channels = samples.shape
    if depth == 16:
        packed = [row.astype(">u2").tobytes() for row in samples]
    else:
        bits = (samples.reshape(rows, -1, 1) >> np.arange(depth - 1, -1, -1)) & 1
        packed = [np.packbits(row.ravel().astype(np.uint8)).tobytes() for row in bits]
    step = max(1, channels * depth // 8)
    kinds = [0] * rows if kinds is None else list(itertools.islice(kinds, rows))
    head = struct.pack(">IIBBBBB", columns, rows, depth, colour, 0, 0, interlace)
    body = zlib.compress(filtered(packed, kinds, step))
    half = len(body) // 2  # two parts: readers must join them
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + extra
        + chunk(b"tEXt", b"a\0b")
        + chunk(b"IDAT", body[:half])
        + chunk(b"IDAT", body[half:])
        + chunk(b"IEND", b"")
    )


def numbers(rows, columns, channels, depth, seed=0):
    return np.random.default_rng(seed).integers(0, 1 << depth, (rows, columns, channels))


def put(tmp_path, data, name="map.png"):
    path = tmp_path / name
    path.write_bytes(data)
    return path


LUMA = np.array([0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("kinds", [(0,), (1,), (2,), (3,), (4,), (1, 2, 0), (4, 3, 2, 1, 0)])
@pytest.mark.parametrize(("colour", "channels", "depth"), [(0, 1, 8), (2, 3, 8), (4, 2, 8), (6, 4, 8), (0, 1, 16)])
def test_png_of_every_filter_colour_and_depth(tmp_path, kinds, colour, channels, depth):
    samples = numbers(7, 9, channels, depth)
    if channels in (2, 4):
        samples[2, 3, -1] = 0
    raster = images.read(put(tmp_path, png(samples, depth, colour, itertools.cycle(kinds))))
    grey = samples[..., 0] if channels < 3 else samples[..., :3] @ LUMA
    np.testing.assert_allclose(raster.values, grey[::-1] / (2**depth - 1), rtol=1e-6)
    holes = samples[::-1, :, -1] == 0 if channels in (2, 4) else np.zeros((7, 9), bool)
    np.testing.assert_array_equal(raster.holes, holes)
    assert raster.levels == 2**depth
    assert [f.code for f in raster.findings] == (["coloured-map"] if channels >= 3 else [])


@pytest.mark.parametrize("depth", [1, 2, 4])
@pytest.mark.parametrize("columns", [1, 7, 8, 9])
def test_png_of_few_bits_with_ragged_rows(tmp_path, depth, columns):
    samples = numbers(5, columns, 1, depth)
    for kind in (0, 4):
        raster = images.read(put(tmp_path, png(samples, depth, 0, itertools.repeat(kind))))
        np.testing.assert_allclose(raster.values, samples[::-1, :, 0] / (2**depth - 1), rtol=1e-6)


@pytest.mark.parametrize("shape", [(1, 1), (1, 8), (8, 1), (40, 3), (3, 40)])
def test_png_of_extreme_shapes(tmp_path, shape):
    samples = numbers(*shape, 1, 16)
    raster = images.read(put(tmp_path, png(samples, 16, 0, itertools.cycle((4, 3)))))
    np.testing.assert_allclose(raster.values, samples[::-1, :, 0] / 65535, rtol=1e-6)


def test_png_with_palette_and_transparent_colours(tmp_path):
    palette = np.array([[0, 0, 0], [51, 51, 51], [255, 0, 0]], np.uint8)
    extra = chunk(b"PLTE", palette.tobytes()) + chunk(b"tRNS", bytes([255, 0]))
    raster = images.read(put(tmp_path, png(np.array([[[0], [1], [2], [1]]]), 2, 3, extra=extra)))
    np.testing.assert_allclose(raster.values, [[0, 0.2, 0.2126, 0.2]], rtol=1e-6)
    np.testing.assert_array_equal(raster.holes, [[False, True, False, True]])
    declared = png(np.array([[[5], [700]]]), 16, 0, extra=chunk(b"tRNS", struct.pack(">H", 700)))
    np.testing.assert_array_equal(images.read(put(tmp_path, declared)).holes, [[False, True]])


@pytest.mark.parametrize(("colour", "channels"), [(2, 3), (4, 2), (6, 4)])
def test_png_whose_16_bit_would_become_8_is_refused(tmp_path, colour, channels):
    with pytest.raises(DermisError, match=r"not supported \(found '16 bit.*grey 16-bit PNG"):
        images.read(put(tmp_path, png(numbers(4, 4, channels, 16), 16, colour)))


def test_interlaced_png_is_read(tmp_path):
    # Adam7: each pass holds the pixels from (row, column) on, so many apart, and is filtered by itself
    samples = numbers(9, 11, 1, 16)
    passes = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))
    parts = [samples[r::dr, c::dc] for r, c, dr, dc in passes]
    body = b"".join(filtered([row.astype(">u2").tobytes() for row in part], [0] * len(part), 2) for part in parts)
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 11, 9, 16, 0, 0, 0, 1))
    data = images.png_tiff.PNG + head + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b"")
    np.testing.assert_array_equal(images.read(put(tmp_path, data)).values, np.float32(samples[::-1, :, 0] / 65535))


# --- TIFF, from the format's own description


def tiff(samples, bits, *, order="<", photometric=1, sample_format=1, compression=1):
    """Encode samples of shape (rows, columns, channels), the first row at the top, in one strip."""
    rows, columns, channels = samples.shape
    kind = {8: "u1", 16: "u2", 32: "f4"}[bits] if sample_format != 2 else f"i{bits // 8}"
    body = samples.astype(order + kind).tobytes()
    body = zlib.compress(body) if compression == 8 else body
    extra, at = struct.pack(order + "H" * channels, *[bits] * channels), 8 + len(body)
    depth = (3, channels, at) if channels > 2 else (3, channels, bits * (1 + (channels - 1) * 65536))
    entries = {
        256: (4, 1, columns),
        257: (4, 1, rows),
        258: depth,
        259: (3, 1, compression),
        262: (3, 1, photometric),
        273: (4, 1, 8),
        277: (3, 1, channels),
        278: (4, 1, rows),
        279: (4, 1, len(body)),
        339: (3, 1, sample_format) if channels == 1 else (3, 1, 1),
    }
    out = struct.pack(order + "H", len(entries))
    for tag, (type_, count, value) in entries.items():
        field = struct.pack(order + "HH", value, 0) if type_ == 3 and count == 1 else struct.pack(order + "I", value)
        out += struct.pack(order + "HHI", tag, type_, count) + field
    magic = b"II*\0" if order == "<" else b"MM\0*"
    return magic + struct.pack(order + "I", at + len(extra)) + body + extra + out + bytes(4)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("compression", [1, 8])
@pytest.mark.parametrize("bits", [8, 16])
def test_grey_tiff_is_exact(tmp_path, bits, order, compression):
    samples = numbers(7, 9, 1, bits)
    raster = images.read(put(tmp_path, tiff(samples, bits, order=order, compression=compression), "map.tif"))
    np.testing.assert_array_equal(raster.values, np.float32(samples[::-1, :, 0] / (2**bits - 1)))
    assert raster.levels == 2**bits and not raster.holes.any()


def test_float_tiff_is_taken_as_stored(tmp_path):
    samples = np.array([[[1.5], [-2.0]], [[1e10], [0.25]]])
    raster = images.read(put(tmp_path, tiff(samples, 32, sample_format=3)))
    np.testing.assert_array_equal(raster.values, samples[::-1, :, 0].astype(np.float32))
    assert raster.levels == 0


def test_tiff_in_colour_or_with_white_at_zero(tmp_path):
    samples = numbers(4, 5, 3, 8)
    raster = images.read(put(tmp_path, tiff(samples, 8, photometric=2)))
    np.testing.assert_allclose(raster.values, samples[::-1] @ LUMA / 255, rtol=1e-6)
    for bits in (8, 16):
        grey = numbers(4, 5, 1, bits)
        raster = images.read(put(tmp_path, tiff(grey, bits, photometric=0)))
        np.testing.assert_array_equal(raster.values, np.float32(1 - grey[::-1, :, 0] / (2**bits - 1)))


@pytest.mark.filterwarnings("ignore:Corrupt EXIF data")
@pytest.mark.parametrize(
    ("data", "words"),
    [
        (tiff(numbers(2, 2, 3, 16), 16, photometric=2), "16 bit, 3 samples a pixel.*16-bit PNG"),
        (tiff(numbers(2, 2, 1, 8), 16, sample_format=6), "not supported .*16 bit, complex"),
        (tiff(numbers(2, 2, 1, 8), 8, sample_format=3), "not supported .*8 bit, floating point"),
        (
            tiff(numbers(2, 4, 1, 8), 8).replace(
                struct.pack("<HHII", 256, 4, 1, 4), struct.pack("<HHII", 256, 4, 1, 2)
            ),
            "number of bytes",
        ),
        (tiff(numbers(2, 2, 1, 8), 8, compression=9), "compressed by method 9"),
        (tiff(numbers(40, 40, 1, 8), 8, compression=8).replace(b"\x78\x9c", b"\x78\x9d"), "damaged or cut short"),
        (tiff(numbers(2, 2, 1, 8), 8)[:8], "damaged or cut short"),
        (b"II*\0" + bytes(20), "damaged or cut short"),
    ],
)
def test_tiff_that_is_refused(tmp_path, data, words):
    with pytest.raises(DermisError, match=words):
        images.read(put(tmp_path, data))


def spoiled(data, at, new):
    return data[:at] + new + data[at + len(new) :]


GOOD = png(numbers(4, 4, 1, 8), 8, 0)
EMPTY = chunk(b"IDAT", b"") + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "empty"),
        (b"hello", "not supported"),
        (b"\xff\xd8\xff\xe0" + bytes(20), "JPEG"),
        (b"\x76\x2f\x31\x01" + bytes(20), "OpenEXR"),
        (GOOD[:-20], "cut short"),
        (GOOD[:60] + bytes([GOOD[60] ^ 1]) + GOOD[61:], "damaged"),
        (GOOD[:8], "cut short"),
        (spoiled(GOOD, 20, b"\7"), "checksum"),
        (png(numbers(4, 4, 1, 8), 8, 3), "palette"),
        (png(np.array([[[3]]]), 8, 3, extra=chunk(b"PLTE", bytes(6))), "palette of 2"),
        (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 0, 0, 8, 0, 0, 0, 0)) + EMPTY, "damaged"),
        (
            b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 70000, 70000, 8, 0, 0, 0, 0)) + EMPTY,
            "too large",
        ),
        (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 4, 4, 3, 0, 0, 0, 0)) + EMPTY, "damaged"),
        (GOOD[:33] + chunk(b"IDAT", b"rubbish") + chunk(b"IEND", b""), "damaged"),
        (GOOD[:33] + chunk(b"IDAT", zlib.compress(bytes(7))) + chunk(b"IEND", b""), "fewer pixels"),
        (GOOD[:33] + chunk(b"IDAT", zlib.compress(b"\5" + bytes(19))) + chunk(b"IEND", b""), "damaged"),
        (b"P5 4 4", "cut short"),
        (b"P5 4 4 255\n123", "cut short"),
        (b"P5 0 0 255\n", "0 x 0"),
        (b"P5 x 4 255\n", "malformed"),
        (b"P5 1 1 70000\n\0\0", "1 to 65535"),
        (b"P2 1 1 9 10", "brighter"),
        (b"P2 1 1 99 10 11", "data after the last pixel"),
        (b"P5 2 1 255\n\0\1\0\2", "data after the last pixel.*2 bytes"),
        (b"Pf 1 1 -1\n" + bytes(8), "data after the last pixel"),
        (b"P2 2 1 9 1", "cut short"),
        (b"Pf 1 1 0\n\0\0\0\0", "scale"),
        (b"Pf 2 2 -1\n\0\0\0\0", "cut short"),
        (b"\x93NUMPY\x01\x00", "cannot be read"),
    ],
)
def test_refuses_what_it_cannot_read(tmp_path, data, message):
    with pytest.raises(DermisError, match=message):
        images.read(put(tmp_path, data))


def test_refuses_a_missing_file(tmp_path):
    with pytest.raises(DermisError, match="cannot be read"):
        read(tmp_path / "none.png")
    with pytest.raises(DermisError, match="no such image"):
        images.sequence(tmp_path / "none.png")
    with pytest.raises(DermisError, match="no image"):
        read([])


# --- netpbm, PFM, NPY


def test_pgm_and_ppm(tmp_path):
    wide = np.array([[0, 256, 65535], [1, 2, 513]])
    for data in (
        b"P5\n# a comment\n3 2\n65535\n" + wide.astype(">u2").tobytes(),
        b"P2 3 2 #x\n65535\n0 256 65535 # more\n1 2 513\n",
    ):
        np.testing.assert_allclose(images.read(put(tmp_path, data)).values, wide[::-1] / 65535, rtol=1e-6)
    raster = images.read(put(tmp_path, b"P6 2 1 200\n" + bytes([100, 100, 100, 200, 0, 0])))
    np.testing.assert_allclose(raster.values, [[0.5, 0.2126]], rtol=1e-6)
    np.testing.assert_allclose(images.read(put(tmp_path, b"P3 1 1 10 5 5 5")).values, [[0.5]])
    assert images.read(put(tmp_path, b"P5 1 1 255\n\n")).values[0, 0] == pytest.approx(10 / 255)
    several = b"P5 1 1 255\n\x20\nP5 1 1 255\n\x30"  # as streams hold them: the first is read
    assert images.read(put(tmp_path, several)).values[0, 0] == pytest.approx(32 / 255)


@pytest.mark.parametrize(("kind", "scale"), [("<f4", b"-1.0"), (">f4", b"1.0")])
def test_pfm_keeps_its_values_and_its_bottom_row_first(tmp_path, kind, scale):
    values = np.array([[1.5, -2.0], [1e10, 0.25]], np.float32)
    raster = images.read(put(tmp_path, b"Pf\n2 2\n" + scale + b"\n" + values.astype(kind).tobytes()))
    np.testing.assert_array_equal(raster.values, values)


@pytest.mark.parametrize("kind", ["u1", "<u2", ">u2", "<f4", ">f8", "?"])
def test_npy_of_any_kind(tmp_path, kind):
    values = np.array([[0, 1, 1], [1, 0, 1]]).astype(kind)
    np.save(tmp_path / "a.npy", values)
    largest = {"u1": 255, "<u2": 65535, ">u2": 65535}.get(kind, 1)
    np.testing.assert_allclose(images.read(tmp_path / "a.npy").values, values[::-1].astype(float) / largest)


def test_npy_never_unpickles_and_refuses_other_shapes(tmp_path):
    for array, message in (
        (np.array([{"a": 1}]), "cannot be read"),
        (np.zeros(3), "not an image"),
        (np.zeros((2, 2), complex), "real numbers"),
        (np.zeros((0, 4)), "4 x 0"),
    ):
        np.save(tmp_path / "b.npy", array, allow_pickle=True)
        with pytest.raises(DermisError, match=message):
            images.read(tmp_path / "b.npy")


# --- sequences


def test_sequence_runs_from_the_named_file_to_the_first_gap(tmp_path):
    for name in ("d_0008", "d_0009", "d_0010", "d_0012", "e_0009", "d_9", "d"):
        put(tmp_path, GOOD, f"{name}.png")
    names = [p.name for p in images.sequence(tmp_path / "d_0009.png")]
    assert names == ["d_0009.png", "d_0010.png"], "the named file is the first"
    gap = images.gap_after(tmp_path / "d_0008.png")
    assert gap is not None and (gap.code, gap.severity, gap.count) == ("sequence-gap", "warning", 1)
    assert gap.value == "d_0010.png, then d_0012.png"
    assert images.gap_after(tmp_path / "d_0012.png") is None, "what lies before the named file is no gap"
    assert images.gap_after(tmp_path / "e_0009.png") is images.gap_after(tmp_path / "d.png") is None
    assert images.sequence(tmp_path / "d.png") == (tmp_path / "d.png",)


def test_sequence_is_read_as_maps_and_must_be_of_one_size(tmp_path):
    stack = [numbers(4, 5, 1, 16, seed=i) for i in range(3)]
    paths = [put(tmp_path, png(s, 16, 0), f"m{i}.png") for i, s in enumerate(stack)]
    heights = read(images.sequence(paths[0])).heights
    assert heights.shape == (3, 4, 5)
    np.testing.assert_allclose(heights, np.stack([s[::-1, :, 0] for s in stack]) / 65535, rtol=1e-6)
    put(tmp_path, png(numbers(5, 4, 1, 16), 16, 0), "m3.png")
    with pytest.raises(DermisError, match=r"'m3.png'.*differ in size.*4 x 5"):
        read(images.sequence(paths[0]))


def test_findings_of_a_sequence_are_counted_together(tmp_path):
    stack = [numbers(6, 6, 4, 8, seed=i) for i in range(3)]
    for samples in stack:
        samples[1, 1:3, 3] = 0
        samples[0, :, 3] = 255
    for i, samples in enumerate(stack):
        samples[2:, :, 3] = 255
        samples[1, 0, 3] = samples[1, 3:, 3] = 255
        put(tmp_path, png(samples, 8, 6), f"c{i}.png")
    findings = {f.code: f for f in read(images.sequence(tmp_path / "c0.png")).findings}
    assert findings["holes-filled"].count == 6
    coloured = sum(int(((s[..., 0] != s[..., 1]) | (s[..., 1] != s[..., 2])).sum()) for s in stack)
    assert findings["coloured-map"].count == coloured


SEVEN = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)]


def streamed(stream, columns, rows, depth, colour, interlace=0, pieces=3):
    """Encode a PNG of a stream that is packed already, in several chunks, with an empty one among them."""
    head = struct.pack(">IIBBBBB", columns, rows, depth, colour, 0, 0, interlace)
    size = -(-len(stream) // pieces)
    parts = [stream[i : i + size] for i in range(0, len(stream), size)]
    palette = chunk(b"PLTE", bytes(range(48))) if colour == 3 else b""
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + palette
        + b"".join(chunk(b"IDAT", part) for part in [parts[0], b"", *parts[1:]])
        + chunk(b"IEND", b"")
    )


def unfiltered(columns, rows, depth, channels, interlace):
    """Return rows of zeros, each behind the number of its filter, as the format's description has them."""
    passes = SEVEN if interlace else [(0, 0, 1, 1)]
    out = b""
    for x, y, dx, dy in passes:
        wide, high = len(range(x, columns, dx)), len(range(y, rows, dy))
        if wide:
            out += bytes(1 + -(-wide * depth * channels // 8)) * high
    return out


@pytest.mark.parametrize("interlace", [0, 1])
@pytest.mark.parametrize(
    ("colour", "channels", "depth"), [(0, 1, 1), (0, 1, 4), (0, 1, 16), (2, 3, 8), (3, 1, 4), (6, 4, 8)]
)
@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (3, 2), (5, 9), (17, 8)])
def test_a_png_has_as_many_pixels_as_its_size_says(tmp_path, interlace, colour, channels, depth, columns, rows):
    whole = unfiltered(columns, rows, depth, channels, interlace)

    def read_with(body):
        return images.read(put(tmp_path, streamed(zlib.compress(body), columns, rows, depth, colour, interlace)))

    assert read_with(whole).values.shape == (rows, columns)
    for body, words in ((whole[:-1], "fewer pixels"), (whole[: len(whole) // 2], "fewer"), (whole + b"\0", "more")):
        with pytest.raises(DermisError, match=f"{words}.*{columns} x {rows}"):
            read_with(body)


def test_a_png_whose_stream_goes_on_without_end_is_refused_soon(tmp_path):
    row = bytes(1 + 2 * 40)
    endless = zlib.compress(bytes(1 << 28), 9)  # 256 MB out of 260 kB
    with pytest.raises(DermisError, match="more pixels than its size.*more than 3240 bytes"):
        images.read(put(tmp_path, streamed(endless, 40, 40, 16, 0, pieces=1)))
    cut = zlib.compress(row * 40)[:-8]  # neither the last bytes nor their check sum
    with pytest.raises(DermisError, match="cut short.*truncated after .* bytes of 3240"):
        images.read(put(tmp_path, streamed(cut, 40, 40, 16, 0)))


def test_a_large_png_in_one_chunk_or_in_many_is_read(tmp_path):
    samples = numbers(700, 900, 1, 16)  # more than is unpacked at a time, and hardly packed at all
    body = b"".join(b"\0" + row.astype(">u2").tobytes() for row in samples)
    for pieces in (1, 9000):
        for level in (0, 6):
            made = images.read(put(tmp_path, streamed(zlib.compress(body, level), 900, 700, 16, 0, pieces=pieces)))
            np.testing.assert_allclose(made.values[::-1], samples[..., 0] / 65535, rtol=1e-6)
    flat = unfiltered(4000, 4000, 8, 1, 0)
    assert images.read(put(tmp_path, streamed(zlib.compress(flat, 9), 4000, 4000, 8, 0))).values.max() == 0
