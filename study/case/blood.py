"""The table of the blood in a case file."""

from typing import Annotated, ClassVar, Literal

from pydantic.dataclasses import dataclass

from jaxfsi.nominal import BLOOD_DENSITY, BLOOD_VISCOSITY, CHO_KENSEY
from study.case.schema import Number, Quantity, Word


@dataclass(frozen=True)
class BloodParameters:
    """The blood: 0D takes its viscosity as constant, 3D can model shear thinning too.

    The parameters of Carreau and Yasuda are those of Cho & Kensey 1991; they act where the law says
    so: μ = μ_inf + (μ_0 − μ_inf)(1 + (λγ)^a)^((n−1)/a) at the shear rate γ.
    """

    added_later: ClassVar[frozenset[str]] = frozenset(
        {"law", "mu_zero", "mu_infinite", "relaxation_time", "transition", "exponent"}
    )
    mu: Annotated[
        Number,
        Quantity(
            "viscosity", "poise", 0.008, 0.2, name="viscosity",
            text="viscosity; under the Carreau-Yasuda law it counts in 0D alone",
        ),
    ] = BLOOD_VISCOSITY  # fmt: skip
    rho_f: Annotated[
        Number, Quantity("density", "g_per_cm3", 0.8, 1.3, name="density", text="density")
    ] = BLOOD_DENSITY
    law: Annotated[
        Literal["newtonian", "carreau_yasuda"], Word(text="viscosity of the blood in 3D")
    ] = "newtonian"
    mu_zero: Annotated[
        Number, Quantity("viscosity", "poise", 0.02, 10.0, name="mu_0", text="at rest")
    ] = CHO_KENSEY["mu_zero"]
    mu_infinite: Annotated[
        Number,
        Quantity(
            "viscosity", "poise", 0.008, 0.2, name="mu_inf", text="at a high shear rate"
        ),
    ] = CHO_KENSEY["mu_infinite"]  # fmt: skip
    relaxation_time: Annotated[
        Number, Quantity("time", "s", 1.0e-3, 100.0, name="lambda", text="relaxation time")
    ] = CHO_KENSEY["relaxation_time"]
    transition: Annotated[
        Number, Quantity("number", "", 0.1, 10.0, name="a", text="how sharp the transition is")
    ] = CHO_KENSEY["transition"]
    exponent: Annotated[
        Number, Quantity("number", "", 0.0, 1.0, name="n", text="exponent of the power law")
    ] = CHO_KENSEY["exponent"]
