"""Frictional contact of a fingertip along [S1]'s sliding path, and along one that never settles.

Timed is a whole frame of `PathSolver`: gaps to the plane, history, solve and float64 check. The path error is the RMS
difference of the nodal forces from a run to 1e-9 with its own history, over the RMS of those forces. The plane is
pressed on over the first 100 frames, which are not timed. Peers in the same run, on the same mesh: one assembly and
factorisation (what a direct penalty step costs at least), one back-substitution (what it costs with the factors kept),
and one step of MuJoCo's flex for the same 1/240 s (where it is installed).
"""

from __future__ import annotations

import functools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from . import Result, benchmark, measure, one_blas_thread, timing

if TYPE_CHECKING:
    from core.skin.mesh import TetraMesh

MU, DEPTH, RATE, FRAMES, PRESS = 0.6, 2e-3, 240.0, 480, 100
STROKE, OMEGA = 0.02, np.pi / 4  # Source: [S1] eq. 19


@dataclass(frozen=True)
class Run:
    """Forces of the timed frames, their times [ms], and what the solver counted."""

    forces: Any
    times: list[float]
    first: float
    counters: dict[str, int]


@benchmark("contact_6k_ms", limit=0.35, quick=True)
def contact_6k() -> Result:
    """One frame at 6k tetrahedra, with its peers."""
    ours = timing(_run("standard", "sliding").times)
    peers = dict(zip(("refactor", "backsolve"), _direct(), strict=True))
    flex = _mujoco()
    if isinstance(flex, float):
        peers["mujoco flex, one step"] = flex
    return Result("contact_6k_ms", ours.median, "ms", ours.p95, peers)


@benchmark("contact_6k_worst_ms", limit=10.0, quick=True)
def contact_6k_worst() -> Result:
    """The worst frame of the sliding path; the first touch at full depth, without any preparation, beside it."""
    run = _run("standard", "sliding")
    return Result("contact_6k_worst_ms", max(run.times), "ms", None, {"jump into contact": run.first})


@benchmark("contact_6k_p95_ms", limit=1.5, quick=True)
def contact_6k_p95() -> Result:
    """The 95th percentile of the sliding path."""
    return Result("contact_6k_p95_ms", timing(_run("standard", "sliding").times).p95, "ms")


@benchmark("contact_6k_p95_ratio", limit=1.5, quick=True)
def contact_6k_p95_ratio() -> Result:
    """The same over the median."""
    found = timing(_run("standard", "sliding").times)
    return Result("contact_6k_p95_ratio", found.p95 / found.median, "1")


@benchmark("contact_6k_path_error", limit=1e-3, quick=True)
def contact_6k_path_error() -> Result:
    """RMS force error along the sliding path, relative; the worst frame beside it."""
    return _error("contact_6k_path_error", "standard", "sliding")


@benchmark("contact_6k_over_refactor", limit=1 / 200, quick=True)
def contact_6k_over_refactor() -> Result:
    """Our frame as a share of one assembly and factorisation."""
    ours = timing(_run("standard", "sliding").times).median
    return Result("contact_6k_over_refactor", ours / _direct()[0], "1")


@benchmark("contact_6k_over_mujoco", limit=1 / 30, quick=True)
def contact_6k_over_mujoco() -> Result:
    """Our frame as a share of one step of MuJoCo's flex of the same mesh, for the same 1/240 s."""
    flex = _mujoco()
    if not isinstance(flex, float):
        return Result("contact_6k_over_mujoco", None, "1", error=flex)
    ours = timing(_run("standard", "sliding").times).median
    return Result("contact_6k_over_mujoco", ours / flex, "1")


@benchmark("contact_6k_varied_ms", limit=1.0, quick=True)
def contact_6k_varied() -> Result:
    """One frame of a path on which depth, tilt and direction never settle."""
    ours = timing(_run("standard", "varied").times)
    return Result("contact_6k_varied_ms", ours.median, "ms", ours.p95, {"worst": max(_run("standard", "varied").times)})


@benchmark("contact_6k_varied_error", limit=1e-3, quick=True)
def contact_6k_varied_error() -> Result:
    """RMS force error along the path that never settles."""
    return _error("contact_6k_varied_error", "standard", "varied")


@benchmark("contact_27k_ms", limit=9.0)
def contact_27k() -> Result:
    """One frame at 27k tetrahedra."""
    ours = timing(_run("fine", "sliding").times)
    return Result("contact_27k_ms", ours.median, "ms", ours.p95, {"worst": max(_run("fine", "sliding").times)})


@benchmark("contact_27k_path_error", limit=5e-3)
def contact_27k_path_error() -> Result:
    """RMS force error along the sliding path at 27k tetrahedra."""
    return _error("contact_27k_path_error", "fine", "sliding")


@benchmark("idle_finger_us", limit=50.0, quick=True)
def idle_finger() -> Result:
    """A frame of `SkinSampler` for a finger that five objects fly past: broad phase, bookkeeping and all.

    In chunks of 64 samples, as a sweep hands them over; in chunks of one beside it, the dearest way there is.
    """
    from fractions import Fraction

    from core.contact.skin_sampler import SkinSampler
    from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene
    from tests.benchmarks.bench_gap import even_sphere

    vertices, triangles = even_sphere(22, 0.02)
    ball = Mesh(vertices, triangles.astype(np.int32))
    bodies = tuple(Body(f"ball {i}", ball, {"friction": MU}) for i in range(5))
    scene = TactileScene(
        "idle", Fraction(24), (1, 100), RATE, (Finger("index", (), {"solved_at": "samples"}),), bodies, (), ()
    )
    per_frame = {}
    for size in (64, 1):
        sampler = SkinSampler(scene, {0: _skin("standard")})
        times = []
        for number in range(40 if size > 1 else 201):
            at = np.arange(number * size, (number + 1) * size)
            fingers, objects = np.tile(np.eye(4), (1, size, 1, 1)), np.tile(np.eye(4), (5, size, 1, 1))
            objects[:, :, 2, 3] = -0.1 - 0.05 * np.arange(5)[:, None]
            objects[:, :, 0, 3] = 1e-4 * at
            chunk = Chunk(at / 10 + 1, at / RATE, fingers, objects, np.zeros((0, size, 4, 4)))
            started = time.perf_counter()
            sampler.add(chunk)
            times.append((time.perf_counter() - started) * 1e3 / size)
        if sampler._steppers[0].counters["idle"] != len(times) * size:
            raise RuntimeError("the finger was not idle")
        per_frame[size] = timing(times)
    ours, single = per_frame[64], per_frame[1]
    return Result("idle_finger_us", ours.median * 1e3, "us", ours.p95 * 1e3, {"chunks of one": single.median * 1e3})


def _error(name: str, level: str, path: str) -> Result:
    ours, exact = _run(level, path).forces, _run(level, path, 1e-9).forces
    scale = np.sqrt((exact**2).sum(axis=(1, 2)).mean())
    frames = np.sqrt(((ours - exact) ** 2).sum(axis=(1, 2)))
    rms, worst = np.sqrt((frames**2).mean()) / scale, frames.max() / scale
    return Result(name, float(rms), "1", None, {"worst frame": float(worst)})


@functools.cache
def _skin(level: str) -> Any:
    from core.skin.model import fingertip_skin

    return fingertip_skin(level=level)


def _poses(path: str, lowest: float) -> Iterator[tuple[Any, Any]]:
    """Rotation and place [m] of the plane, first pressing, then moving."""
    for frame in range(-PRESS, FRAMES):
        t = max(frame, 0) / RATE
        press = min(1.0, (frame + PRESS) / PRESS)
        if path == "sliding":
            along = -STROKE * np.cos(OMEGA * t)
            yield np.eye(3), np.array([0.0, along, lowest + DEPTH * press])
            continue
        a, b = 0.15 * np.sin(2 * np.pi * 0.9 * t), 0.1 * np.sin(5.0 * t)
        about_y = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
        about_x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
        depth = press * (1.4e-3 + 0.6e-3 * np.sin(2 * np.pi * 1.3 * t))
        place = [4e-3 * np.sin(2 * np.pi * 1.1 * t), 4e-3 * np.sin(2 * np.pi * 0.8 * t), lowest + depth]
        yield about_y @ about_x, np.array(place)


@functools.cache
def _run(level: str, path: str, tolerance: float | None = None) -> Run:
    from core.contact.solver.bodies import ContactBody
    from core.contact.solver.nodes import Nodes
    from core.contact.solver.path_solver import TOLERANCE, PathSolver
    from core.surface.plane import Plane

    skin = _skin(level)
    plane = Plane(np.array([0.0, 0.0, 1.0]), np.zeros(3))
    poses = list(_poses(path, float(skin.positions[:, 2].min())))
    with one_blas_thread():
        solver = PathSolver(
            Nodes.of(skin.positions, skin.normals, None, skin.compliance), tolerance=tolerance or TOLERANCE
        )
        rotation, place = poses[PRESS]
        started = time.perf_counter()
        solver.step([ContactBody(plane, rotation, place, MU)])
        first = (time.perf_counter() - started) * 1e3
        solver.reset()
        forces, times = [], []
        for frame, (rotation, place) in enumerate(poses):
            started = time.perf_counter()
            step = solver.step([ContactBody(plane, rotation, place, MU)])
            if frame >= PRESS:
                times.append((time.perf_counter() - started) * 1e3)
                forces.append(step.solution.force)
        if solver.counters["unconverged"]:
            raise RuntimeError(f"{solver.counters['unconverged']} frames did not converge")
    return Run(np.array(forces), times, first, dict(solver.counters))


@functools.cache
def _direct() -> tuple[float, float]:
    """Median times [ms] of one assembly with factorisation, and of one back-substitution.

    LAPACK's banded Cholesky after reverse Cuthill-McKee, the quickest of what scipy offers for this matrix (SuperLU
    needs five times as long); the ordering is kept and not timed.
    """
    from scipy.linalg import cho_solve_banded, cholesky_banded
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    from core.skin.assembly import degrees, stiffness
    from core.skin.material import Elastic

    mesh = _skin("standard").mesh
    free = degrees(mesh.free)
    order = free[reverse_cuthill_mckee(stiffness(mesh, Elastic())[free][:, free].tocsr(), True)]

    def factor() -> Any:
        matrix = stiffness(mesh, Elastic())[order][:, order].tocoo()
        below = matrix.row - matrix.col
        kept = below >= 0
        band = np.zeros((int(below.max()) + 1, matrix.shape[0]))
        band[below[kept], matrix.col[kept]] = matrix.data[kept]
        return cholesky_banded(band, lower=True, overwrite_ab=True, check_finite=False)

    factors = factor()
    load = np.ones(free.size)
    back = measure(lambda: cho_solve_banded((factors, True), load, check_finite=False), 51)
    return measure(factor, 9).median, back.median


@functools.cache
def _mujoco() -> float | str:
    """Median time of one step [ms] of the same mesh, pressed and slid over as ours is, or why there is none.

    MuJoCo 4 with its own solver, iterations and tolerance, and the integrator that it names for stiff flexes; older
    versions blow up. One step covers a whole frame, though 2 ms are recommended. At nu = 0.48 it warns that its linear
    solve ran out of iterations, and its contacts are soft: it is timed for less than is asked of ours.
    """
    try:
        import mujoco
    except ImportError:
        return "mujoco is not installed in this environment"
    mesh = _skin("standard").mesh
    places = [place for _, place in _poses("sliding", float(mesh.nodes[:, 2].min()))]
    timed = 21
    moves = iter([*places[: PRESS - 1 : 4], *places[PRESS : PRESS + timed]])  # pressed on in a quarter of the frames
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)  # else it writes a file into the working folder
    try:
        model = mujoco.MjModel.from_xml_string(flex_model(mesh, 1.0 / RATE, MU))
        data = mujoco.MjData(model)

        def move() -> None:
            data.mocap_pos[0] = next(moves)

        warmup = len(places[: PRESS - 1 : 4])
        flex = measure(lambda: mujoco.mj_step(model, data), timed, warmup=warmup, setup=move).median
    except ValueError as error:
        return f"mujoco {mujoco.__version__}: {str(error).splitlines()[0]}"
    finally:
        mujoco.set_mju_user_warning(None)
    if not np.isfinite(data.qpos).all() or any(
        data.warning[kind].number for kind in (mujoco.mjtWarning.mjWARN_BADQACC, mujoco.mjtWarning.mjWARN_BADQPOS)
    ):
        return f"mujoco {mujoco.__version__} is unstable on this mesh"
    if not data.ncon:
        return f"mujoco {mujoco.__version__} found no contact"
    return flex


def flex_model(mesh: TetraMesh, step: float, friction: float) -> str:
    """Return MuJoCo's text of a mesh held where ours is, and of a plate whose top is its body's origin.

    Args:
        step: of time [s]. friction: Coulomb's coefficient.
    """
    points = " ".join(f"{x:.9g}" for x in mesh.nodes.reshape(-1))
    elements = " ".join(str(i) for i in mesh.tetrahedra.reshape(-1))
    pins = " ".join(str(i) for i in mesh.fixed)
    return f"""
<mujoco><option timestep="{step:.9g}" integrator="discrete" gravity="0 0 0"/><size memory="2G"/>
<worldbody>
<body name="plate" mocap="true"><geom type="box" size=".1 .1 .005" pos="0 0 -.005" friction="{friction}"/></body>
<flexcomp name="skin" type="direct" dim="3" radius="1e-5" mass="0.005" point="{points}" element="{elements}">
<elasticity young="1e5" poisson="0.48" damping="1e-3"/><contact selfcollide="none" friction="{friction}"/>
<pin id="{pins}"/></flexcomp></worldbody></mujoco>"""
