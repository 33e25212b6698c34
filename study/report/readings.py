"""How the equations of the method paper are read where its print leaves a choice.

Paper: Puelz et al. 2024, arXiv 2405.01703.
"""

READINGS: tuple[tuple[str, str], ...] = (
    (
        "Proximal resistances",
        "P = P_wk + R Q. The paper prints Q/R_c and Q/R_1; the units ask for the product.",
    ),
    (
        "Decay of the aortic pressure",
        "Starts from the pressure at valve closure and ends at the diastolic pressure; the "
        "paper's constant gamma is evaluated at closure.",
    ),
    (
        "Ventricular pressure",
        "A bump between 0.0692 T and 0.4 T with the systolic pressure as its peak; zero "
        "elsewhere. Two symbols of the paper (t_s, t_sys) are taken for the same time.",
    ),
    (
        "Intramyocardial node",
        "The state is the pressure across C_im, so that a jump of the ventricular pressure moves "
        "no volume and no derivative of it is needed.",
    ),
    (
        "Stress rule",
        '"printed": R_2 halves, C_a and C_im double, as in the equations. "all": every resistance '
        "halves, as the text says. Both are shown.",
    ),
    (
        "FFR",
        "Ratio of the cycle means of distal and aortic pressure, under stress. The same ratio at "
        "rest is called the resting ratio (Pd/Pa).",
    ),
    (
        "Periodic state",
        "Solved for directly. Four cycles from an arbitrary start, as in the paper, can miss "
        "alpha by several per cent.",
    ),
    (
        "R0",
        "Linear law: slope of the pressure-flow curve at a drop of 40 mmHg, as in the paper, here "
        "from the lumen's reduced law unless given. The slope at 40 mmHg overstates the "
        "resistance at rest; the quadratic law R0 Q + K Q|Q| keeps the whole curve.",
    ),
)
"""Topic and reading."""
