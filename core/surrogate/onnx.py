"""ONNX files of networks, written and checked without the onnx package.

ONNX is a protocol-buffer message. This module writes a fixed graph of ten kinds of operators in opset 17, in double
precision. The input `features`, shape (n, p), has the pose and the components of trial forces and friction forces. The
input `slopes`, shape (n, p, d), is the derivative of `features` with respect to the pose. The outputs are `stress`,
shape (n, c), and `jacobian`, shape (n, c, d). A JSON text in the model's metadata names the skin and the device for
which the network was trained. onnxruntime runs the model.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..files import read_bytes, write_bytes
from ..foreign import json_of
from ..version import version
from .network import Network

OPSET, IR_VERSION = 17, 8  # versions of ONNX: of the set of operators, and of the file format
META = "dermis"  # key of the metadata of this product
SCHEMA = "dermis-surrogate 2"
OLDER = ("dermis-surrogate 1",)  # earlier schemas, whose inputs do not show which nodes touch and which stick
INPUTS, OUTPUTS = ("features", "slopes"), ("stress", "jacobian")
MAX_SIZE = 1 << 16  # largest number of inputs and of outputs; the finest skin has a few thousand
_DOUBLE = 11  # TensorProto.DOUBLE
_INT64 = 7  # TensorProto.INT64


def dumps(network: Network, meta: Mapping[str, Any] | None = None) -> bytes:
    """Return a network as an ONNX model; equal networks give equal bytes.

    Args:
        network: the network.
        meta: plain values about the training, such as the keys of skin and device.
    """
    p, c, h = network.inputs, network.outputs, network.hidden
    ways = int((meta or {}).get("freedoms", 3))
    weights = network.weights / network.scale
    bias = network.bias - weights @ network.centre
    # Softplus is computed as log(1 + e^-|z|) + max(z, 0), because in some runtimes the operator Softplus overflows or
    # exists only in single precision.
    nodes = [
        _node("MatMul", ["features", "weights"], ["uw"]),
        _node("Add", ["uw", "bias"], ["z"]),
        _node("Abs", ["z"], ["abs"]),
        _node("Neg", ["abs"], ["minus"]),
        _node("Exp", ["minus"], ["e"]),
        _node("Add", ["e", "one"], ["e1"]),
        _node("Log", ["e1"], ["log"]),
        _node("Relu", ["z"], ["relu"]),
        _node("Add", ["log", "relu"], ["active"]),
        _node("MatMul", ["active", "readout"], ["sum"]),
        _node("Add", ["sum", "offset"], ["stress"]),
        _node("Sigmoid", ["z"], ["gate"]),
        _node("Unsqueeze", ["gate", "axis"], ["gates"]),
        _node("MatMul", ["across", "slopes"], ["along"]),
        _node("Mul", ["gates", "along"], ["gated"]),
        _node("MatMul", ["rows", "gated"], ["jacobian"]),
    ]
    tensors = {
        "weights": weights.T,
        "bias": bias,
        "one": np.ones(1),
        "readout": network.output_weights.T,
        "offset": network.offset,
        "rows": network.output_weights[None],
        "across": weights[None],
    }
    graph = b"".join(_field(1, node) for node in nodes)
    graph += _field(2, b"surrogate")
    graph += b"".join(_field(5, _tensor(name, value)) for name, value in tensors.items())
    graph += _field(5, _tensor("axis", np.array([2], np.int64)))
    graph += _field(11, _value("features", ("n", p))) + _field(11, _value("slopes", ("n", p, ways)))
    graph += _field(12, _value("stress", ("n", c))) + _field(12, _value("jacobian", ("n", c, ways)))
    text = json.dumps({**(meta or {}), "schema": SCHEMA, "inputs": p, "hidden": h, "outputs": c}, sort_keys=True)
    return b"".join(
        [
            _varint(1, IR_VERSION),
            _field(2, b"dermis"),
            _field(3, version().encode()),
            _field(7, graph),
            _field(8, _field(1, b"") + _varint(2, OPSET)),
            _field(14, _field(1, META.encode()) + _field(2, text.encode())),
        ]
    )


def write(path: Path, network: Network, meta: Mapping[str, Any] | None = None) -> None:
    """Write a network as an ONNX file, atomically.

    Raises:
        DermisError: the file cannot be written.
    """
    write_bytes(path, dumps(network, meta))


class _Bound:
    """Session of onnxruntime with fixed arrays for inputs and outputs.

    A call of `run` therefore allocates little memory.
    """

    def __init__(self, session: Any, inputs: int, outputs: int, ways: int) -> None:
        self._features, self._slopes = np.zeros((1, inputs)), np.zeros((1, inputs, ways))
        self._stress, self._jacobian = np.zeros((1, outputs)), np.zeros((1, outputs, ways))
        self._binding, self._session = session.io_binding(), session
        for names, arrays, bind in (
            (INPUTS, (self._features, self._slopes), self._binding.bind_input),
            (OUTPUTS, (self._stress, self._jacobian), self._binding.bind_output),
        ):
            for name, array in zip(names, arrays, strict=True):
                bind(name, "cpu", 0, np.float64, array.shape, array.ctypes.data)

    def run(self, features: Array, slopes: Array) -> tuple[Array, Array]:
        """Return the stress, shape (c,), and the Jacobian, shape (c, d).

        Args:
            features: inputs of the network, shape (p,).
            slopes: derivative of the inputs with respect to the pose, shape (p, d).
        """
        self._features[0], self._slopes[0] = features, slopes
        self._session.run_with_iobinding(self._binding)
        return self._stress[0].copy(), self._jacobian[0].copy()


class OnnxFit:
    """A network in an ONNX file, run by onnxruntime.

    Args:
        path: path of the file.
        expected: values that the metadata must have, such as {'skin': ..., 'device': ...}.

    Raises:
        DermisError: onnxruntime is missing or cannot run the file; the file is not a complete ONNX model of this
            product; its inputs, outputs, shapes or opset are not those that this product writes; or its metadata do not
            have the `expected` values.
    """

    def __init__(self, path: Path, expected: Mapping[str, Any] | None = None) -> None:
        where = str(path)
        data = read_bytes(path)
        self.meta = read_meta(data, where)
        for name, wanted in (expected or {}).items():
            if self.meta.get(name) != wanted:
                raise DermisError(
                    f"the surrogate was trained for another {name}",
                    where=where,
                    value=self.meta.get(name),
                    limit=str(wanted),
                    remedy="Adapt it to this one again, or use the direct method",
                )
        try:
            import onnxruntime
        except ImportError as error:
            raise DermisError("onnxruntime is not installed", where=where, remedy="Use the direct method") from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(
                data, options, providers=["CPUExecutionProvider"], enable_fallback=0
            )
            self._check(where)
        except DermisError:
            raise
        # onnxruntime raises its own exceptions for damaged files, and other exceptions for names that are not text.
        except Exception as error:
            raise DermisError("onnxruntime cannot run this file", where=where, value=str(error)[:200]) from error
        self._bound: _Bound | None = None

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return int(self.meta["inputs"])

    @property
    def outputs(self) -> int:
        """Number of channels."""
        return int(self.meta["outputs"])

    @property
    def _ways(self) -> int:
        return int(self.meta.get("freedoms", 3))

    def predict(self, u: Array) -> Array:
        """Return the channels, shape (n, c), for rows of inputs, shape (n, p)."""
        u = np.atleast_2d(np.asarray(u, np.float64))
        return self._session.run(["stress"], {"features": u, "slopes": np.zeros((*u.shape, self._ways))})[0]

    def along(self, u: Array, ways: Array) -> tuple[Array, Array]:
        """Return the channels and their derivatives along given directions.

        The shapes are (c,) and (c, d).

        Args:
            u: inputs, shape (p,).
            ways: derivative of the inputs with respect to the pose, shape (p, d).
        """
        if self._bound is None:
            self._bound = _Bound(self._session, self.inputs, self.outputs, self._ways)
        return self._bound.run(u, ways)

    def _check(self, where: str) -> None:
        p, c, n = self.inputs, self.outputs, self._ways
        wanted = {"features": [None, p], "slopes": [None, p, n], "stress": [None, c], "jacobian": [None, c, n]}
        found = {v.name: (v.type, v.shape) for v in [*self._session.get_inputs(), *self._session.get_outputs()]}
        for name, shape in wanted.items():
            kind, sizes = found.get(name, ("missing", []))
            fits = len(sizes) == len(shape) and all(b is None or a == b for a, b in zip(sizes, shape, strict=True))
            if kind != "tensor(double)" or not fits:
                raise DermisError(
                    f"'{name}' has the wrong type or shape",
                    where=where,
                    value=f"{kind} {sizes}",
                    limit=f"tensor(double) {shape}",
                )


def read_meta(data: bytes, where: str = "") -> dict[str, Any]:
    """Return the metadata of an ONNX model that this product wrote.

    Args:
        data: content of the file.
        where: name of the file, for errors.

    Raises:
        DermisError: the data are not an ONNX model or are truncated; the metadata are missing, belong to another
            product or an older schema, or have impossible sizes; or the opset is missing or newer.
    """
    text, opset = None, 0
    try:
        for number, value in _fields(data):
            if number == 8 and isinstance(value, bytes):
                opset = max(opset, *(v for n, v in _fields(value) if n == 2 and isinstance(v, int)), 0)
            if number == 14 and isinstance(value, bytes):
                pair = dict(_fields(value))
                if pair.get(1) == META.encode() and isinstance(pair.get(2), bytes):
                    text = pair[2]
        meta = json_of(text, where) if isinstance(text, bytes) else None
    except DermisError:
        raise
    except (ValueError, IndexError, struct.error) as error:
        raise DermisError(
            "the ONNX file is incomplete or damaged",
            where=where,
            value=str(error) or None,
            remedy="Make it again, or use the direct method",
        ) from error
    if isinstance(meta, dict) and meta.get("schema") in OLDER:
        raise DermisError(
            "the surrogate has an older format",
            where=where,
            value=meta["schema"],
            limit=SCHEMA,
            remedy="Adapt it again, or use the direct method",
        )
    if not isinstance(meta, dict) or meta.get("schema") != SCHEMA:
        raise DermisError(
            "an ONNX file that Dermis did not make",
            where=where,
            value=meta.get("schema") if isinstance(meta, dict) else None,
            limit=SCHEMA,
            remedy="Use a surrogate made here, or the direct method",
        )
    if not 1 <= opset <= OPSET:
        raise DermisError("unsupported ONNX operator set", where=where, value=opset, limit=f"1 to {OPSET}")
    sizes = [meta.get(n) for n in ("inputs", "outputs")]
    freedoms = meta.get("freedoms", 3)  # older files lack this value; they were made for three degrees of freedom only
    enough = type(freedoms) is int and freedoms in (3, 6)
    if not enough or not all(
        type(n) is int and low <= n <= MAX_SIZE for n, low in zip(sizes, (freedoms, 1), strict=True)
    ):
        raise DermisError("impossible sizes", where=where, value=str(sizes)[:80], limit=f"up to {MAX_SIZE}")
    return meta


# -- protocol buffers: https://protobuf.dev/programming-guides/encoding ------------------------------------------------


def _number(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _varint(field: int, value: int) -> bytes:
    return _number(field << 3) + _number(value)


def _field(field: int, data: bytes) -> bytes:
    return _number(field << 3 | 2) + _number(len(data)) + data


def _node(kind: str, inputs: list[str], outputs: list[str], **attributes: int) -> bytes:
    data = b"".join(_field(1, n.encode()) for n in inputs) + b"".join(_field(2, n.encode()) for n in outputs)
    data += _field(4, kind.encode())
    for name, value in attributes.items():
        data += _field(5, _field(1, name.encode()) + _varint(3, value) + _varint(20, 2))  # AttributeProto.INT
    return data


def _tensor(name: str, value: NDArray[Any]) -> bytes:
    value = np.ascontiguousarray(value)
    kind = _INT64 if value.dtype == np.int64 else _DOUBLE
    data = b"".join(_varint(1, n) for n in value.shape) + _varint(2, kind) + _field(8, name.encode())
    return data + _field(9, value.astype("<i8" if kind == _INT64 else "<f8").tobytes())


def _value(name: str, shape: tuple[int | str, ...]) -> bytes:
    sizes = b"".join(_field(1, _field(2, n.encode()) if isinstance(n, str) else _varint(1, n)) for n in shape)
    return _field(1, name.encode()) + _field(2, _field(1, _varint(1, _DOUBLE) + _field(2, sizes)))


def _fields(data: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Yield field numbers and values of a message.

    A truncated message raises ValueError or IndexError.
    """
    at = 0
    while at < len(data):
        key, at = _read_number(data, at)
        kind = key & 7
        if kind == 0:
            value, at = _read_number(data, at)
            yield key >> 3, value
        elif kind in (1, 2, 5):
            size, at = (8, at) if kind == 1 else (4, at) if kind == 5 else _read_number(data, at)
            if at + size > len(data):
                raise ValueError(f"cut off at byte {len(data)}")
            yield key >> 3, data[at : at + size]
            at += size
        else:
            raise ValueError(f"no protocol buffer at byte {at}")


def _read_number(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
        if shift > 63:
            raise ValueError(f"no protocol buffer at byte {at}")
