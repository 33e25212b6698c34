"""Tables of a case whose keys do not depend on each other, one class each.

A field holds its value in CGS; its metadata says how a file spells it, in which unit and range, and
what it means (`study.case.schema`).
"""

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic.dataclasses import dataclass

from jaxfsi.nominal import (
    CHECKPOINT_EVERY,
    MAX_HALVINGS,
    MAX_ITERATIONS,
    MAX_SYSTEMS,
    WALL_DENSITY,
)
from lumped.nominal import C0_NOMINAL, NOMINAL
from study.case.schema import Number, Quantity, Word


@dataclass(frozen=True)
class PatientParameters:
    """The patient."""

    id: Annotated[
        str,
        Word(
            text="names the results",
            pattern=r"[A-Za-z0-9]([A-Za-z0-9._-]{0,62}[A-Za-z0-9_-])?",
            described='a name that can be a file name: letters, digits, ". _ -", at most 64',
            example="patient-01",
        ),
    ]


@dataclass(frozen=True)
class TissueParameters:
    """Tissue outside the wall in 3D: springs and dashpots on its outer surface, in each direction.

    A traction of stiffness times displacement plus damping times velocity acts against the wall.
    """

    stiffness: Annotated[
        Number,
        Quantity("support", "dyn_per_cm3", 0.0, 1.0e9, text="traction over displacement"),
    ] = 0.0
    damping: Annotated[
        Number,
        Quantity("support damping", "dyn_s_per_cm3", 0.0, 1.0e7, text="traction over velocity"),
    ] = 0.0


@dataclass(frozen=True)
class WallParameters:
    """The vessel wall. Its thickness follows the local radius of the lumen, within bounds.

    The law holzapfel_gasser_ogden has two families of collagen fibres in a neo-Hookean matrix of E
    and nu, slack in the shape of the image: E is the stiffness there, and fibres add to it where
    they are stretched, each k1/(2 k2) (exp(k2 e²) − 1) to the stored energy at the strain e of
    Gasser, Ogden & Holzapfel 2006, J R Soc Interface 3:15. It needs k1, which has no usual value:
    typical are 2.4 kPa with k2 0.84 and 29 deg for the media of a rabbit's carotid, and 1 MPa with
    k2 500, 50 deg and dispersion 0.23 for the adventitia of a human artery, both from unloaded
    arteries, whose matrix is far softer than the least E here.
    """

    added_later: ClassVar[frozenset[str]] = frozenset(
        {
            "volumetric_penalty", "damping", "tissue", "minimum_gap", "k1", "k2", "fibre_angle",
            "dispersion", "E_coronary", "E_septum",
        }
    )  # fmt: skip
    E: Annotated[
        Number, Quantity("stiffness", "dyn_per_cm2", 2.0e5, 3.0e8, text="Young's modulus")
    ] = 1.5e7
    nu: Annotated[
        Number,
        Quantity(
            "number", "", 0.0, 0.5, text="Poisson's ratio; in 3D at most 0.499",
            advice="give Poisson's ratio, at most 0.5",
        ),
    ] = 0.49  # fmt: skip
    rho_s: Annotated[
        Number, Quantity("density", "g_per_cm3", 0.5, 3.0, name="density", text="density")
    ] = WALL_DENSITY
    material: Annotated[
        Literal["linear", "saint_venant_kirchhoff", "neo_hookean", "holzapfel_gasser_ogden"],
        Word(text="elastic law in 3D"),
    ] = "saint_venant_kirchhoff"
    element: Annotated[
        Literal["bending", "linear", "quadratic"],
        Word(
            text="bending: wedges where columns fit in the wall; linear hardly bends;"
            " quadratic takes three times as long as linear"
        ),
    ] = "bending"
    prestress: Annotated[
        Literal["diastole", "none"],
        Word(text="pressure that the wall carries in the shape of the image"),
    ] = "diastole"
    thickness_per_radius: Annotated[
        Number,
        Quantity(
            "number", "", 0.01, 1.0,
            text="over the radius, 0.5 to 1.5 mm; or { factor = ..., min_mm = ..., max_mm = ... }",
        ),
    ] = 0.1  # fmt: skip
    thickness_min: Number | None = None
    thickness_max: Number | None = None
    volumetric_penalty: Annotated[
        Number,
        Quantity(
            "stiffness", "dyn_per_cm2", 0.0, 1.0e10,
            text="added resistance to changes of volume of saint_venant_kirchhoff",
        ),
    ] = 0.0  # fmt: skip
    damping: Annotated[
        Number,
        Quantity("viscosity", "poise", 0.0, 1.0e6, text="Kelvin-Voigt viscosity of the wall in 3D"),
    ] = 0.0
    minimum_gap: Annotated[
        Number,
        Quantity(
            "length", "mm", 0.0, 1.0,
            text="gap below which sides of the lumen repel each other in 3D; 0: never",
        ),
    ] = 0.0  # fmt: skip
    k1: Annotated[
        Number,
        Quantity("stiffness", "dyn_per_cm2", 0.0, 1.0e9, text="stiffness of the fibres"),
    ] = 0.0
    k2: Annotated[
        Number, Quantity("number", "", 0.0, 1.0e4, text="how fast the fibres stiffen")
    ] = 1.0
    fibre_angle: Annotated[
        Number,
        Quantity("angle", "deg", 0.0, 90.0, text="from the circumference of the lumen to a fibre"),
    ] = math.radians(35.0)
    dispersion: Annotated[
        Number,
        Quantity(
            "number", "", 0.0, 1.0 / 3.0,
            text="of the fibres: 0 aligned, 1/3 in all directions",
            advice="give kappa, from 0, aligned, to 1/3, in all directions",
        ),
    ] = 0.0  # fmt: skip
    E_coronary: Annotated[
        Number | None,
        Quantity(
            "stiffness", "dyn_per_cm2", 2.0e5, 3.0e8,
            text="Young's modulus of the anomalous coronary in 3D; without it, that of the wall",
            example=1.8e7,
        ),
    ] = None  # fmt: skip
    E_septum: Annotated[
        Number | None,
        Quantity(
            "stiffness", "dyn_per_cm2", 2.0e5, 3.0e8,
            text="Young's modulus between aorta and coronary in 3D; without it, that of the wall",
            example=1.4e7,
        ),
    ] = None  # fmt: skip
    tissue: TissueParameters = TissueParameters()

    @property
    def part_moduli(self) -> tuple[Number, Number, Number]:
        """Young's moduli of aorta, coronary and septum."""
        coronary, septum = (self.E if E is None else E for E in (self.E_coronary, self.E_septum))
        return self.E, coronary, septum


@dataclass(frozen=True)
class ThicknessBounds:
    """The thickness of the wall as a table."""

    factor: Annotated[
        Number, Quantity("number", "", 0.01, 1.0, text="wall thickness over local radius")
    ] = WallParameters.thickness_per_radius
    min: Annotated[
        Number | None,
        Quantity("length", "mm", 0.01, 5.0, text="least thickness; else 0.5 mm", example=0.3),
    ] = None
    max: Annotated[
        Number | None,
        Quantity("length", "mm", 0.05, 10.0, text="largest; else 1.5 mm", example=2.0),
    ] = None


@dataclass(frozen=True)
class CoronaryParameters:
    """The five-element coronary outlet at rest, before calibration (after Puelz et al. 2024)."""

    R_1: Annotated[
        Number,
        Quantity("resistance", "dyn_s_per_cm5", 1.0e3, 1.0e8, text="proximal arterial resistance"),
    ] = NOMINAL["R_1"]
    R_2: Annotated[
        Number,
        Quantity("resistance", "dyn_s_per_cm5", 1.0e3, 1.0e8, text="microvascular resistance"),
    ] = NOMINAL["R_2"]
    R_3: Annotated[
        Number, Quantity("resistance", "dyn_s_per_cm5", 1.0e3, 1.0e8, text="venous resistance")
    ] = NOMINAL["R_3"]
    C_a: Annotated[
        Number, Quantity("compliance", "cm5_per_dyn", 1.0e-10, 1.0e-4, text="arterial compliance")
    ] = NOMINAL["C_a"]
    C_im: Annotated[
        Number,
        Quantity("compliance", "cm5_per_dyn", 1.0e-10, 1.0e-4, text="intramyocardial compliance"),
    ] = NOMINAL["C_im"]
    P_venous: Annotated[
        Number, Quantity("pressure", "mmHg", -5.0, 40.0, text="behind R_3; 0: see [uncertainty]")
    ] = 0.0
    im_factor: Annotated[
        Number,
        Quantity(
            "number", "", 0.0, 3.0, text="factor of the ventricular pressure on C_im",
            advice="give the factor of the LV pressure, usually 1",
        ),
    ] = 1.0  # fmt: skip


Resistance = Annotated[
    Number | None,
    Quantity(
        "resistance", "dyn_s_per_cm5", 10.0, 1.0e7, name="R0", also=("mmHg_s_per_ml",),
        text="linear resistance, or { value = ..., sd_log = ... } with the sd of its logarithm",
        example=5.0e3,
    ),
]  # fmt: skip
QuadraticLoss = Annotated[
    Number | None,
    Quantity(
        "quadratic loss", "dyn_s2_per_cm8", 0.0, 1.0e7, name="K", also=("mmHg_s2_per_ml2",),
        text="quadratic loss", example=1.0e3,
    ),
]  # fmt: skip


@dataclass(frozen=True)
class SurrogateParameters:
    """The anomalous artery in 0D, dP = R0 Q + K Q abs(Q).

    Under the linear law the resting ratio fixes alpha/R0, so that FFR does not depend on R0: jaxfsi
    run needs no R0; only alpha and flow depend on it. With an ivus anatomy R0 and K follow from it.
    """

    R0: Resistance = None
    K: QuadraticLoss = None
    C0: Annotated[
        Number, Quantity("compliance", "cm5_per_dyn", 1.0e-10, 1.0e-4, text="compliance")
    ] = C0_NOMINAL
    law: Annotated[
        Literal["linear", "quadratic"], Word(text="linear leaves K out")
    ] = "linear"  # fmt: skip
    R0_sd_log: Number | None = None


@dataclass(frozen=True)
class StressParameters:
    """How the outlet changes from rest to stress: a named rule, or own factors.

    The rules printed and all are two readings of the published one. The table [stress.factors]
    takes R_1, R_2, R_3, C_a and C_im (each 1.0 where absent) in place of a rule.
    """

    rule: Annotated[
        Literal["printed", "all", "factors"],
        Word(options=("printed", "all"), text="reading of the published rule"),
    ] = "printed"
    factors: dict[str, Any] | None = None


STRESS_FACTORS = tuple(
    Quantity("number", "", 0.01, 100.0, name=name, field=name, default=1.0) for name in NOMINAL
)
"""Keys of [stress.factors]."""


@dataclass(frozen=True)
class WindkesselParameters:
    """The Windkessel behind the aorta in 3D."""

    characteristic: Annotated[
        Literal["impedance", "paper"],
        Word(text="in series: the characteristic impedance of the aorta, or 10 dyn s/cm5"),
    ] = "impedance"


@dataclass(frozen=True)
class SolverOptions:
    """Numerical choices. Where a key has no default, the command chooses.

    One default is not that of the core, which has rho_infinity = 0.5. Geometry is extrapolated in
    time, and the two pressures on the sides of an intramural wall shake it: 0 damps most.
    """

    added_later: ClassVar[frozenset[str]] = frozenset(
        {"frames_per_cycle", "checkpoint_every", "max_halvings", "rho_infinity",
         "max_systems", "max_iterations"}
    )  # fmt: skip
    dt: Annotated[
        float | None,
        Quantity("time", "s", 1.0e-7, 0.1, text="step of a 3D run, usually 1e-3", example=1.0e-3),
    ] = None
    cycles: Annotated[
        int | None,
        Quantity("number", "", 1.0, 1000.0, whole=True, text="cycles of a 3D run", example=4),
    ] = None
    n_steps: Annotated[
        int | None,
        Quantity(
            "number", "", 8.0, 1.0e6, whole=True, text="samples of a cycle in 0D", example=1000
        ),
    ] = None  # fmt: skip
    frames_per_cycle: Annotated[
        int,
        Quantity("number", "", 1.0, 1000.0, whole=True, text="3D: fields written in a cycle"),
    ] = 40
    checkpoint_every: Annotated[
        int,
        Quantity("number", "", 1.0, 1.0e6, whole=True, text="3D: steps between two checkpoints"),
    ] = CHECKPOINT_EVERY
    tolerance: Annotated[
        float | None,
        Quantity(
            "number", "", 1.0e-10, 0.1, example=1.0e-3,
            text="3D: by how much the residual of a step is reduced, usually 1e-3",
        ),
    ] = None  # fmt: skip
    max_halvings: Annotated[
        int,
        Quantity(
            "number", "", 0.0, 12.0, whole=True,
            text="3D: how often a step that fails may be halved",
        ),
    ] = MAX_HALVINGS  # fmt: skip
    change_limit: Annotated[
        float | None,
        Quantity(
            "number", "", 1.0e-6, 10.0, example=0.03,
            text="3D: largest change of a step; absent: steps of equal length",
        ),
    ] = None  # fmt: skip
    rho_infinity: Annotated[
        float,
        Quantity(
            "number", "", 0.0, 1.0,
            text="3D: spectral radius at infinite frequency; 1 damps nothing",
        ),
    ] = 0.0  # fmt: skip
    max_systems: Annotated[
        int,
        Quantity(
            "number", "", 1.0, 100.0, whole=True, text="3D: linear systems in a step at most"
        ),
    ] = MAX_SYSTEMS  # fmt: skip
    max_iterations: Annotated[
        int,
        Quantity(
            "number", "", 1.0, 1000.0, whole=True,
            text="3D: iterations of GMRES in a system at most",
        ),
    ] = MAX_ITERATIONS  # fmt: skip


@dataclass(frozen=True)
class MeshOptions:
    """How the anatomy is meshed and in which unit the mesh is written."""

    preset: Annotated[
        Literal["coarse", "medium", "fine"],
        Word(text="about 30 000, 150 000 or 500 000 tetrahedra"),
    ] = "medium"
    elements_across: Annotated[
        int | None,
        Quantity(
            "number", "", 2.0, 24.0, whole=True, example=8,
            text="least number across the narrowest width; medium: 6, fine: 8",
        ),
    ] = None  # fmt: skip
    wall_layers: Annotated[
        int,
        Quantity(
            "number", "", 1.0, 8.0, whole=True, text="layers of elements through the wall"
        ),
    ] = 2  # fmt: skip
    wedge_layers: Annotated[
        int,
        Quantity(
            "number", "", 0.0, 4.0, whole=True,
            text="layers of wedges through the wall; 0: tetrahedra alone, or 1 where it bends",
        ),
    ] = 0  # fmt: skip
    backend: Annotated[
        Literal["netgen", "gmsh", "tetgen"], Word(text="mesher of volumes")
    ] = "netgen"  # fmt: skip
    unit: Annotated[Literal["cm", "mm"], Word(text="of the mesh files")] = "cm"
