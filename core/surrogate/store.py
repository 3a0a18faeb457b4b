"""Training, saving and loading of surrogates.

A surrogate is kept in two files. `NAME.npz` has the descriptors, their error curves and the quadratic ridge.
`NAME.onnx` has the network, which other programs can use too. Both files name the skin, device and friction for which
they were made, and are refused for any others. A surrogate of linear tissue can be used for neo-Hookean tissue of the
same shape, but not the reverse. Files of the first schema are recognised, and must be made again: the
inputs of their models do not show which nodes touch and which stick.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Generator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..cache import cache_key
from ..devices.disc import DiscContact
from ..devices.disc_device import DiscDevice
from ..devices.disc_pose import Disc
from ..errors import DermisError
from ..files import write_npz
from ..foreign import damage_told, json_of
from ..npz import read_npz
from ..parameters.error_bands import LINEAR
from ..skin.model import SkinModel
from ..skin.observation import Observer
from ..steps import in_words
from . import onnx
from .learned import Descriptors, descriptors
from .lessons import KINDS, judged, lessons
from .network import HIDDEN, ITERATIONS, Network, train
from .press_points import press_points, pressed_on
from .ridge import QuadraticRidge, fit_ridge
from .soundness import check_parts
from .subspace import TOLERANCE, Subspace
from .surrogate import Surrogate, check_made_for

SCHEMA = "dermis-surrogate 2"
TRAJECTORIES = 2400  # Source: [S0] 4.1
# Number of straight presses on linear skin that describe the stress of a skin with a nonlinear law. It is that of
# `matching.description`: with more movements, the number of components changes by one at most.
DESCRIBED = 240
_RIDGE = ("centre", "scale", "constant", "linear", "quadratic")


def device_key(device: DiscDevice) -> str:
    """Return a key of the device's properties that affect a skin."""
    usual = {"side": 1.0, "bounds": None}  # values of most devices, which are left out of the key
    parts = {k: _plain(v) for k, v in asdict(cast(Any, device)).items()}
    if "bend" in parts:
        parts["knee"] = parts.pop("bend")  # the name in presets and in the keys of earlier models
    told = {k: v for k, v in parts.items() if k not in usual or v != usual[k]}
    return cache_key(json.dumps(told, sort_keys=True))[:32]


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    return None if value is None else np.asarray(value).tolist()


def place_of(folder: Path, skin: SkinModel, device: DiscDevice, friction: float) -> Path:
    """Return the path of a surrogate in a folder.

    It depends on the skin's shape and tissue, the device and the friction coefficient.
    """
    tissue = (skin.tissue,) if skin.follows_law else ()
    key = cache_key(SCHEMA, skin.key, pressed_on(skin), device_key(device), repr(float(friction)), *tissue)
    return Path(folder) / f"{key[:32]}.npz"


def contact_of(device: DiscDevice, skin: SkinModel, friction: float) -> DiscContact:
    """Return the contact of a device's disc with a skin.

    The disc presses on points of the skin's smooth pad, or on the nodes of the mesh if there is no smooth pad.
    """
    return DiscContact(press_points(skin), Disc(radius=device.disc_radius), friction)


def adapt(
    device: DiscDevice,
    skin: SkinModel,
    friction: float,
    *,
    trajectories: int = TRAJECTORIES,
    seed: int = 0,
    tolerance: float = TOLERANCE,
    hidden: int = HIDDEN,
    iterations: int = ITERATIONS,
    report: Callable[[str, int, int], None] | None = None,
) -> Generator[tuple[str, int, int], None, Surrogate]:
    """Make a surrogate for a skin.

    Movements are recorded, descriptors are found, and the ridge and the network are fitted. If the skin follows a
    nonlinear law, contact and stress of all movements are computed by this law. The components of stress are those of a
    few movements on linear skin, as for the direct method.

    Yields (stage, done, total) and returns the surrogate.

    Args:
        device: the device.
        skin: the skin; the surrogate is made for its tissue.
        friction: friction coefficient.
        trajectories: number of straight presses, see `lessons`; half of them are held out.
        seed: seed of the movements and of the network's initial weights.
        tolerance: largest relative RMS error of the descriptors of stress, see `descriptors`.
        hidden: number of neurons in the hidden layer.
        iterations: largest number of iterations of the training.
        report: function that is called with (stage, done, total) during the training, which is one long step of the
            generator.

    Raises:
        DermisError: the servo limits exclude contact, or a setting is out of range.
    """
    described: Descriptors | None = None
    if skin.follows_law:
        few = lessons(
            device, contact_of(device, skin.linear, friction), min(trajectories, DESCRIBED), seed + len(KINDS)
        )
        first = yield from in_words(few, lambda step: ("stress", *step))
        described = descriptors(first.data, skin.stress_components(), tolerance=tolerance)
    observer = None if described is None else Observer(skin, described.observation_matrix)
    recording = lessons(device, contact_of(device, skin, friction), trajectories, seed, observer)
    found = yield from in_words(recording, lambda step: ("dataset", *step))
    yield "descriptors", 0, 1
    if described is None:
        spaces = descriptors(found.data, skin.stress_components(), tolerance=tolerance)
    else:
        spaces = described.remembering(found.data)
    table = spaces.table(found.data)
    yield "training", 0, iterations

    def told(i: int, n: int) -> None:
        if report is not None:
            report("training", i, n)

    ridge = fit_ridge(table)
    network = train(table, hidden=hidden, iterations=iterations, seed=seed, report=told)
    yield "training", iterations, iterations
    tests = {name: spaces.table(data) for name, data in found.held_out.items()}
    held_out = {"ridge": judged(ridge, tests), "network": judged(network, tests)}
    meta = {
        "schema": SCHEMA,
        "skin": skin.key,
        "pressed_on": pressed_on(skin),
        "device": device_key(device),
        "friction": friction,
        "modulus": skin.material.modulus,
        "freedoms": device.freedoms,
        "samples": len(found.data),
        "movements": len(np.unique(found.data.trajectory)),
        **{f"{name}_error": errors["straight"]["error"] for name, errors in held_out.items()},
        "held_out": held_out,
        "tissue": skin.tissue,
        "unsettled": found.data.unsettled,
    }
    return Surrogate(spaces, ridge, network, meta)


def tissue_of(meta: Mapping[str, Any]) -> str:
    """Return the tissue for which a surrogate was made, from its metadata.

    Files that do not state it were made for linear tissue.
    """
    return str(meta.get("tissue", LINEAR))


def _check_tissue(made: str, wanted: str, where: str) -> None:
    if made not in (LINEAR, wanted):
        raise DermisError(
            "the surrogate was made for another tissue",
            where=where,
            value=made,
            limit=wanted,
            remedy="Adapt it to this one, or use the direct method",
        )


def errors_by_law(meta: Mapping[str, Any]) -> dict[str, float]:
    """Return the errors by a nonlinear law of 'network' and 'ridge' of linear tissue, from metadata.

    Earlier versions computed them for a skin with such a law. Without them the result is empty.
    """
    found = meta.get("by_law")
    if not isinstance(found, Mapping):
        return {}
    errors = {n: found[n].get("error") for n in ("network", "ridge") if isinstance(found.get(n), Mapping)}
    return {n: float(error) for n, error in errors.items() if isinstance(error, int | float)}


def save(path: Path, surrogate: Surrogate) -> tuple[Path, Path]:
    """Write NAME.npz and NAME.onnx and return their paths.

    Args:
        path: one of the two paths, or NAME.
        surrogate: the surrogate; its network must be a trained one, not one from a file.

    Raises:
        DermisError: the network was read from a file, or a file cannot be written.
    """
    if not isinstance(surrogate.network, Network):
        raise DermisError(
            "a surrogate that was read from a file cannot be saved", where=str(path), remedy="Copy the file"
        )
    spaces, meta = surrogate.descriptors, dict(surrogate.meta)
    arrays: dict[str, NDArray[Any]] = {"meta": np.frombuffer(json.dumps(meta, sort_keys=True).encode(), np.uint8)}
    for name, space in (("stress", spaces.stress), ("trial", spaces.trial), ("friction", spaces.friction)):
        arrays.update({f"{name}_mean": space.mean, f"{name}_basis": space.basis, f"{name}_curve": space.curve})
    arrays["readout"] = spaces.observation_matrix
    arrays.update({f"ridge_{n}": getattr(surrogate.ridge, n) for n in _RIDGE})
    tables, graph = Path(path).with_suffix(".npz"), Path(path).with_suffix(".onnx")
    onnx.write(graph, surrogate.network, meta)
    write_npz(tables, arrays)  # written last: if this file exists, the surrogate is complete
    return tables, graph


def load(path: Path, skin: SkinModel, device: DiscDevice, friction: float) -> Surrogate:
    """Read a surrogate for a skin and device.

    Args:
        path: one of the two paths, or NAME, see `save`.
        skin: the skin.
        device: the device.
        friction: friction coefficient.

    Raises:
        DermisError: a file is missing, damaged or foreign, was made for another skin, device or friction, or its parts
            do not fit together; or it was made for nonlinear tissue, and the skin is linear.
    """
    tables, graph = Path(path).with_suffix(".npz"), Path(path).with_suffix(".onnx")
    where = str(tables)
    for path in (tables, graph):
        if not os.path.isfile(path):
            raise DermisError(
                "no surrogate was adapted to this finger",
                where=str(path),
                limit="a .npz and a .onnx",
                remedy="Adapt one to this finger, or use the direct method",
            )
    remedy = "Adapt it again, or use the direct method"
    try:
        arrays = read_npz(tables, where, "a surrogate")
    except DermisError as error:
        raise error.changed(what="the surrogate cannot be read", value=error.what, remedy=remedy) from error
    with damage_told("the surrogate cannot be read", where, remedy=remedy):
        meta = dict(json_of(arrays["meta"].tobytes(), where))
    if meta.get("schema") in onnx.OLDER:
        raise DermisError(
            "the surrogate has an older format", where=where, value=meta["schema"], limit=SCHEMA, remedy=remedy
        )
    with damage_told("the surrogate cannot be read", where, remedy=remedy):
        spaces = {
            n: Subspace(*(arrays[f"{n}_{part}"] for part in ("mean", "basis", "curve")))
            for n in ("stress", "trial", "friction")
        }
        ridge = QuadraticRidge(*(arrays[f"ridge_{n}"] for n in _RIDGE))
        observation_matrix = arrays["readout"]
    expected = {
        "schema": SCHEMA,
        "skin": skin.key,
        "pressed_on": pressed_on(skin),
        "device": device_key(device),
        "friction": friction,
    }
    for name, wanted in expected.items():
        check_made_for(meta, name, wanted, where)
    alike = {n: expected[n] for n in ("skin", "pressed_on", "device", "friction")}
    if "tissue" in meta:
        alike["tissue"] = meta["tissue"]
    network = onnx.OnnxFit(graph, alike)
    made = Surrogate(
        Descriptors(spaces["stress"], observation_matrix, spaces["trial"], spaces["friction"]), ridge, network, meta
    )
    _check_tissue(tissue_of(meta), skin.tissue, where)
    check_parts(made, 3 * skin.pad_count, device.freedoms, where)
    return made
