"""Settings of a finger's skin, and of the contact of the skin.

`SKIN` has the rows of a skin preset. `SKIN_CONTACT` has the settings of the contact.
"""

from __future__ import annotations

from .parameter import SWITCH, TEXT, Parameter, table

DEFAULT_SKIN = "index_medium"  # preset for a finger that states no skin
# Places at which contact is solved if a finger states none: 'nodes' of the mesh, or 'points' on the smooth skin.
CONTACT = "points"
# Largest error of the force for objects pressed 0.5 to 1.5 mm deep (edges rounded by 0.2 mm), relative to a converged
# reference. The benchmark `shape_force_error` measures it. At nodes it is larger for slides over an edge, see
# presets/ACCURACY.md.
FORCE_ERRORS = {
    "points": "planes 2 %, balls 3 %, edges 4 % (of 60 degrees 12 %)",
    "nodes": "planes 2 %, balls 19 %, edges 98 %",
}
TETRAHEDRA = {"draft": "1.6k", "standard": "6.4k", "fine": "26k"}  # number of tetrahedra in a mesh, in words for users


def _length(name: str, label: str, text: str, default: float) -> Parameter:
    return Parameter(
        name=name,
        unit="m",
        label=label,
        text=text,
        source="chosen: a typical adult's",
        default=default,
        low=0.05e-3,
        high=2.0,
        saved=f"{name}_mm",
        window_unit="mm",
        soft=(None, 60e-3),
    )


# Lengths that also define the outer shape of the finger's mesh in Blender.
OUTER = table(
    _length("width", "Width", "Width of the finger at the pad's centre", 16e-3),
    _length("thickness", "Thickness", "Thickness of the finger from pad to back, at the pad's centre", 13e-3),
    _length("length", "Length", "Length of the fingertip from its cut end to the tip", 24e-3),
    _length("tip", "Pad to Tip", "Distance from the pad's centre to the tip", 10.5e-3),
    _length("nail_width", "Nail Width", "Width of the nail, which holds the tissue under it", 10.5e-3),
    _length("nail_length", "Nail Length", "Length of the nail along the finger", 11e-3),
    _length("nail_margin", "Nail to Tip", "Distance from the nail's front edge to the tip", 1.5e-3),
)
LENGTHS = table(
    *OUTER.values(),
    _length("bone_width", "Bone Width", "Of the last phalanx's shaft", 6.4e-3),
    _length("bone_thickness", "Bone Thickness", "Of the last phalanx's shaft", 4.6e-3),
    _length("bone_bed", "Bone to Back", "Thickness of the soft tissue between bone and back of the finger", 2e-3),
    _length("bone_margin", "Bone to Tip", "Thickness of the soft tissue between the bone's end and the tip", 4.5e-3),
)
TISSUE = table(
    Parameter(
        name="young",
        unit="Pa",
        label="Stiffness E",
        text="Young's modulus of the tissue",
        source="[S1] section IV.A, 100 kPa",
        default=1e5,
        low=1.0,
        high=1e9,
        saved="young_kpa",
        window_unit="kPa",
        soft=(10e3, 1e6),
        digits=1,
    ),
    Parameter(
        name="poisson",
        unit="1",
        label="Poisson's Ratio",
        text="Poisson's ratio of the tissue. 0.5 is incompressible; close to it, averaged nodal pressure oscillates",
        source="[S1] section IV.A, 0.48",
        default=0.48,
        low=0.0,
        high=0.499,
        soft=(0.3, None),
        digits=3,
    ),
    Parameter(
        name="alpha",
        unit="1",
        label="Personal Factor",
        text="This person's stiffness divided by E (alpha), from a press test. The paper reports 0.61 to 0.90; by the "
        "wording of its fit this would be the inverse, and 1.11 to 1.64 here",
        source="[S1] section IV.D",
        default=1.0,
        low=1e-3,
        high=1e3,
        soft=(0.3, 3.0),
    ),
)
# A tetrahedral mesh of the user, which replaces the lengths.
OWN_MESH = table(
    Parameter(
        name="mesh",
        unit=TEXT,
        label="Mesh File",
        text="File of your own tetrahedral mesh, .npz or .json, instead of lengths and accuracy. The format is "
        "described in presets/skins/README.md",
        saved="mesh_file",
        file=True,
        default="",
    ),
    Parameter(name="mesh_hash", unit=TEXT, text="SHA-256 of the mesh file: one that changed is refused", default=""),
)
SKIN = table(*LENGTHS.values(), *TISSUE.values(), *OWN_MESH.values())

# Entries of `Finger.parameters`. The entry 'skin' of `Finger.parameters` has the rows of `SKIN`.
SKIN_CONTACT = table(
    Parameter(
        name="skin_shown",
        unit=SWITCH,
        label="Skin",
        text="Simulate this finger's skin: show it in the view and bake its forces",
        default=False,
        saved="shown",
    ),
    Parameter(
        name="skin_level",
        unit=TEXT,
        label="Accuracy",
        text="Fineness of the tissue's mesh",
        default="standard",
        saved="level",
        choices=(
            ("draft", "Draft", f"About {TETRAHEDRA['draft']} tetrahedra: for several fingers while scrubbing"),
            (
                "standard",
                "Standard",
                f"About {TETRAHEDRA['standard']} tetrahedra: on a flat press force is within 2 %, stress within 6 % of "
                "a much finer mesh; for other objects see Contact",
            ),
            ("fine", "Fine", f"About {TETRAHEDRA['fine']} tetrahedra: for final figures; made once in some seconds"),
        ),
        besides=("reference",),
        note="'reference', with 88k tetrahedra, is for scripts, because it is too slow for a window",
    ),
    Parameter(
        name="tissue",
        unit=TEXT,
        label="Tissue",
        text="Material law of the finger's tissue",
        default="linear",
        choices=(
            ("linear", "Linear", "Displacement is proportional to load: for light touch"),
            (
                "neo_hookean",
                "Neo-Hookean",
                "Stiffens under load and shears as rubber does; a frame takes less than twice as long. For presses "
                "deeper than half a millimetre, and for drag. At 2 mm depth the stress 1.6 mm below the skin is off "
                "by up to 10 % on the standard mesh (Fine: 5 %)",
            ),
        ),
        besides=("neo_hookean_exact",),
        note="files of older versions name the neo-Hookean tissue 'neo_hookean_exact'. For devices that press on "
        "the skin, the search runs on linear skin, corrected by the same law at each sample, on any fingertip "
        "and mesh. Poisson's ratio and E are those of linear tissue, which is the limit of the law for small "
        "loads",
    ),
    Parameter(
        name="contact",
        unit=TEXT,
        label="Contact",
        text="Points at which contact is solved",
        default=CONTACT,
        choices=(
            (
                "points",
                "Points on the Skin",
                "On points of the smooth skin, 0.8 mm apart on flat surfaces and down to 0.2 mm under edges, ribs and "
                "small balls; what fingers hold together stays on the mesh's nodes. Force off by at most, "
                f"where pressed: {FORCE_ERRORS['points']}",
            ),
            (
                "nodes",
                "Nodes of the Mesh",
                "Where the tissue's mesh has nodes, a millimetre or two apart: for flat or gently curved surfaces. "
                f"Force off by at most, where pressed, on the standard mesh: {FORCE_ERRORS['nodes']}",
            ),
        ),
        note="a fingertip whose lengths or Poisson's ratio differ from all presets needs a table, which takes "
        "about 20 s once. Until then, and on a mesh of your own, contact is solved at the nodes, as a finding "
        "says",
    ),
    Parameter(
        name="solved_at",
        unit=TEXT,
        label="Solve",
        text="Samples of a bake at which contact is solved",
        default="way",
        choices=(
            (
                "way",
                "Steps of Movement",
                "Where the finger goes straight on over surfaces that are flat or have no radius below 5 mm, a few "
                "samples at once: at most 0.2 mm and 1/60 s. Forces between lie on a line, within 1 % of those "
                "of every sample solved; up to twice as fast",
            ),
            ("samples", "Every Sample", "Each sample, however small the movement"),
        ),
        note="contact is solved at every sample for fingers that hold an object, that are solved at the mesh's "
        "nodes, or whose touch depth is compliant. A preview solves the frames that it shows",
    ),
    Parameter(
        name="depth_mode",
        unit=TEXT,
        label="Touch Depth",
        text="Behaviour of the bone when the animation presses the finger into an object",
        default="animated",
        choices=(
            ("animated", "As Animated", "The bone follows the animation exactly, at any depth"),
            (
                "compliant",
                "Compliant",
                "The bone rests on a spring along the pad's normal and gives way to what "
                "presses it beyond a force limit, as a finger's joint does",
            ),
        ),
    ),
    Parameter(
        name="bone_stiffness",
        unit="N/m",
        label="Spring",
        text="Stiffness with which the bone is held",
        default=2000.0,
        low=1e-3,
        high=1e9,
        soft=(100.0, 10_000.0),
        digits=0,
    ),
    Parameter(
        name="force_limit",
        unit="N",
        label="Force Limit",
        text="Largest force on the bone; the bone yields to a larger one",
        source="chosen: a firm touch",
        default=2.0,
        low=1e-3,
        soft=(0.1, 10.0),
    ),
)
