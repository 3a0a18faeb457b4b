"""The condensed skin: its cache, stress, probes and components for matching."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.cache import Cache
from core.errors import DermisError
from core.skin import model
from core.skin.fingertip import fingertip_mesh
from core.skin.material import Elastic
from core.skin.model import SkinModel, fingertip_skin, mesh_skin, skin_from_parameters
from core.skin.shape import FingertipShape
from core.skin.stress import RECEPTOR_DEPTHS, locate, nodal_average, receptor_probes, von_mises
from tests.problems import cube_mesh, flat_press, linear_field, uniform_stress
from tests.tissue import stress_norm


@pytest.fixture(scope="module")
def press(skin: SkinModel) -> np.ndarray:
    return flat_press(skin.compliance, skin.positions[:, 2], 1.5e-3)


def files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.rglob("*") if p.is_file() and len(p.name) == 64)


def test_cache_gives_back_the_same_bytes(tmp_path: Path) -> None:
    cache = Cache(tmp_path, 10**9)
    made = fingertip_skin(level="draft", cache=cache)
    response = np.array(made.unit_response)
    assert len(files(tmp_path)) == 2
    read = fingertip_skin(level="draft", cache=cache)
    assert read.mesh.hash == made.mesh.hash and read.key == made.key
    assert read.unit_compliance.tobytes() == made.unit_compliance.tobytes()
    assert np.array_equal(read.unit_response, response)
    bare = fingertip_skin(level="draft")
    assert bare.unit_compliance.tobytes() == made.unit_compliance.tobytes()
    assert np.array_equal(bare.unit_response, response)


def test_the_norm_of_stress_is_read_from_the_cache_to_the_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = Cache(tmp_path, 10**9)
    made = fingertip_skin(level="draft", cache=cache).unit_stress
    monkeypatch.setattr(SkinModel, "_stress_root", None)  # nobody computes it any more
    read = fingertip_skin(material=Elastic(2e5, 0.48, 1.5), level="draft", cache=cache).unit_stress
    assert read.tobytes() == made.tobytes(), "it is that of every stiffness"
    monkeypatch.undo()
    assert fingertip_skin(level="draft").unit_stress.tobytes() == made.tobytes()


def test_damage_and_deletion_are_harmless(tmp_path: Path) -> None:
    cache = Cache(tmp_path, 10**9)
    made = fingertip_skin(level="draft", cache=cache)
    expected, response = made.unit_compliance.tobytes(), np.array(made.unit_response)
    for damage in (b"", b"garbage", None):
        for path in files(tmp_path):
            if damage is None:
                path.write_bytes(path.read_bytes()[:-5000])
            else:
                path.write_bytes(damage)
        again = fingertip_skin(level="draft", cache=cache)
        assert again.unit_compliance.tobytes() == expected and np.array_equal(again.unit_response, response)
    for path in files(tmp_path):
        path.unlink()
    assert made.with_material(young=2e5).displacement(np.ones((made.pad_count, 3))).any()
    again = fingertip_skin(level="draft", cache=cache)
    assert again.unit_compliance.tobytes() == expected
    tiny = Cache(tmp_path / "tiny", 0)  # nothing but the newest file ever stays
    assert np.array_equal(fingertip_skin(level="draft", cache=tiny).unit_response, response)


def test_keys_tell_apart_what_matters_and_nothing_else() -> None:
    def key(**change: object) -> str:
        material = Elastic(float(change.get("young", 1e5)), float(change.get("poisson", 0.48)))  # type: ignore[arg-type]
        shape = FingertipShape(width=float(change.get("width", 16e-3)))  # type: ignore[arg-type]
        return fingertip_skin(
            shape, material, level=str(change.get("level", "draft")), element=change.get("element", "anp")
        ).key  # type: ignore[arg-type]

    base = key()
    assert key(young=5e5) == base
    others = [key(poisson=0.47), key(width=16.5e-3), key(element="p1"), key(level="standard")]
    assert len({base, *others}) == 5
    mesh = fingertip_mesh(level="draft")
    assert mesh_skin(mesh).key != base and mesh_skin(mesh).key == mesh_skin(fingertip_mesh(level="draft")).key


def test_a_loaded_mesh_gives_the_parametric_skin() -> None:
    assert np.array_equal(
        mesh_skin(fingertip_mesh(level="draft")).unit_compliance, fingertip_skin(level="draft").unit_compliance
    )


def test_parameters() -> None:
    model = skin_from_parameters({"width": 14e-3, "young": 2e5, "alpha": 0.8}, level="draft")
    assert model.material.modulus == pytest.approx(1.6e5)
    with pytest.raises(DermisError, match="unknown parameter"):
        skin_from_parameters({"wdth": 14e-3})
    with pytest.raises(DermisError, match="unknown accuracy"):
        fingertip_skin(level="ultra")
    with pytest.raises(DermisError, match="do not fit"):
        model.pad_displacement(np.zeros((3, 3)))


def test_energy_balance(skin: SkinModel, press: np.ndarray) -> None:
    """Half the work of the forces is the strain energy, as the elements store it."""
    work = 0.5 * float((press * skin.pad_displacement(press)).sum())
    assert skin.energy(press) == pytest.approx(work, rel=1e-12)
    assert skin.energy_density(press) @ skin.mesh.volumes == pytest.approx(work, rel=1e-6)
    assert (skin.energy_density(press) >= 0).all()


def test_flat_press_is_complementary_and_stiffens_with_depth(skin: SkinModel) -> None:
    forces = []
    for depth in (0.5e-3, 1e-3, 2e-3):
        force = flat_press(skin.compliance, skin.positions[:, 2], depth)
        gap = skin.positions[:, 2] + skin.pad_displacement(force)[:, 2] - depth
        assert (force[:, 2] >= 0).all() and gap.min() > -1e-15
        assert np.abs(force[:, 2] * gap).max() < 1e-15
        forces.append(force[:, 2].sum())
    assert forces[1] / forces[0] > 2.0 and forces[2] / forces[1] > 2.0  # more than linear: the contact grows


def test_stress_under_a_press_balances_the_plate(skin: SkinModel, press: np.ndarray) -> None:
    """The virtual work of the stress on a uniform strain equals that of forces and reactions, exactly."""
    stress, volumes = skin.stress(press), skin.mesh.volumes
    u = skin.displacement(press)
    from core.skin.assembly import stiffness

    forces = (stiffness(skin.mesh, skin.material) @ u.ravel()).reshape(-1, 3)
    strain_zz = float(stress[:, 2] @ volumes)  # sum of sigma_zz V = sum of f_z z over all nodes
    assert strain_zz == pytest.approx(float(forces[:, 2] @ skin.mesh.nodes[:, 2]), rel=1e-9)
    shear = float(stress[:, 4] @ volumes)
    assert shear == pytest.approx(float(forces[:, 0] @ skin.mesh.nodes[:, 2]), abs=1e-9 * abs(strain_zz))


def test_alpha_leaves_stress_for_given_forces(skin: SkinModel, press: np.ndarray) -> None:
    soft = skin.with_material(young=1e3)
    stress = skin.stress(press)
    assert soft.stress(press) == pytest.approx(stress, rel=1e-6, abs=1e-6 * np.abs(stress).max())
    assert soft.displacement(press) == pytest.approx(100.0 * skin.displacement(press), rel=1e-12)


def test_components_keep_the_norm_of_stress(skin: SkinModel, press: np.ndarray) -> None:
    random = np.random.default_rng(8).normal(size=(20, skin.pad_count, 3))
    full = skin.stress_components()
    for force in (press, random[0]):
        exact = stress_norm(skin.stress(force), skin.mesh.volumes)
        assert np.linalg.norm(full @ force.ravel()) == pytest.approx(exact, rel=1e-4)
    few = skin.stress_components(20, random.reshape(20, -1))
    for force in random:
        exact = stress_norm(skin.stress(force), skin.mesh.volumes)
        assert np.linalg.norm(few @ force.ravel()) == pytest.approx(exact, rel=1e-4)
    norms = [np.linalg.norm(skin.stress_components(k) @ press.ravel()) for k in (5, 20, 80, 3 * skin.pad_count)]
    exact = stress_norm(skin.stress(press), skin.mesh.volumes)
    assert norms == sorted(norms) and norms[0] < 0.999 * exact and norms[-1] == pytest.approx(exact, rel=1e-4)
    with pytest.raises(DermisError):
        skin.stress_components(1000)


def test_the_norm_of_stress_is_computed_in_pieces_to_the_same_last_bit(
    skin: SkinModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SciPy keeps Python's lock during a product of a sparse matrix, and no window waits for a long one."""
    assert 3 * skin.pad_count > 4 * model.COLUMNS
    norms = []
    for columns in (model.COLUMNS, 3 * skin.pad_count):
        monkeypatch.setattr(model, "COLUMNS", columns)
        norms.append(skin._stress_root().tobytes())
    assert norms[0] == norms[1]


def test_probes_read_a_linear_field_exactly() -> None:
    """A linear field of displacement has the same stress in all elements, and at the probes."""
    skin = fingertip_skin(level="draft")
    mesh = skin.mesh
    gradient = np.array([[0.01, 0.02, 0.0], [0.0, -0.01, 0.03], [0.02, 0.0, 0.005]])
    stress = skin.operator.stress(linear_field(mesh.nodes, gradient))
    expected = uniform_stress(gradient, 1e5, 0.48)
    probes = skin.probes
    read = probes.read(stress)
    assert read == pytest.approx(np.broadcast_to(expected, read.shape), rel=1e-9, abs=1e-9 * np.abs(expected).max())
    assert set(np.unique(probes.depth)) == set(RECEPTOR_DEPTHS)
    middles = mesh.nodes[mesh.tetrahedra].mean(axis=1)
    assert probes.read(middles) == pytest.approx(probes.points, abs=1e-12)
    straight = np.linalg.norm(probes.points - mesh.nodes[mesh.pad][probes.pad], axis=1)
    assert straight == pytest.approx(probes.depth, rel=1e-12)
    assert len(probes.points) == 3 * skin.pad_count  # receptors lie in the pulp under every pad node


def test_locate_finds_every_element_and_no_point_outside() -> None:
    mesh = fingertip_mesh(level="draft")
    centres = mesh.nodes[mesh.tetrahedra].mean(axis=1)
    element, weights = locate(mesh, centres)
    assert np.array_equal(element, np.arange(len(centres))) and weights == pytest.approx(np.full_like(weights, 0.25))
    outside = np.array([[0, 0, -1e-3], [0, 0, 9e-3], [0, 20e-3, 5e-3], [1.0, 1.0, 1.0]])  # air, bone, air, far
    assert (locate(mesh, outside)[0] == -1).all()
    assert len(receptor_probes(mesh, (8e-3,)).points) < len(mesh.pad)  # in bone: left out


def test_nodal_average_keeps_constants_and_integrals() -> None:
    mesh = cube_mesh(3, warp=0.05)
    values = np.random.default_rng(9).normal(size=(len(mesh.tetrahedra), 2))
    assert nodal_average(mesh, np.ones(len(mesh.tetrahedra))) == pytest.approx(np.ones(len(mesh.nodes)))
    nodal = np.zeros(len(mesh.nodes))
    np.add.at(nodal, mesh.tetrahedra, mesh.volumes[:, None] / 4)
    assert nodal @ nodal_average(mesh, values) == pytest.approx(mesh.volumes @ values)


def test_von_mises_of_known_states() -> None:
    states = np.array([[5.0, 0, 0, 0, 0, 0], [3.0, 3, 3, 0, 0, 0], [0, 0, 0, 2.0, 0, 0], [1.0, -1, 0, 0, 0, 0]])
    assert von_mises(states) == pytest.approx([5.0, 0.0, 2 * np.sqrt(3), np.sqrt(3)])
