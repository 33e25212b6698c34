"""How long commands usually take, on two cores."""

CASE_SECONDS = {"curve": 10.0, "3d": 3000.0}
"""Of a case of a cohort, by its mode [s]."""

MESH_SECONDS = {
    "reading the anatomy": {"coarse": 1.0, "medium": 1.0, "fine": 1.0},
    "sampling": {"coarse": 13.0, "medium": 13.0, "fine": 13.0},
    "sizes": {"coarse": 3.5, "medium": 4.0, "fine": 4.0},
    "remeshing": {"coarse": 4.0, "medium": 5.0, "fine": 9.0},
    "closing": {"coarse": 5.0, "medium": 16.0, "fine": 50.0},
    "filling": {"coarse": 2.0, "medium": 6.0, "fine": 19.0},
    "checking": {"coarse": 1.5, "medium": 6.0, "fine": 18.0},
    "measuring": {"coarse": 4.0, "medium": 4.0, "fine": 6.0},
    "drawing": {"coarse": 1.0, "medium": 1.0, "fine": 1.0},
}
"""Of each stage of a patient's mesh, by preset [s]."""

PREPARE_SECONDS = {"coarse": 15.0, "medium": 25.0, "fine": 60.0}
"""Of the model and its prestress, by the preset of the mesh [s]."""

COMPILE_SECONDS = {"coarse": 40.0, "medium": 45.0, "fine": 60.0}
"""Of the first step [s]."""

STEP_SECONDS = {"coarse": 0.12, "medium": 0.85, "fine": 4.0}
"""Of a step of a patient's beat [s]."""


def march_seconds(preset: str, n_steps: int) -> float:
    """Usual time of a run on a mesh of a preset, its compiling included [s]."""
    return COMPILE_SECONDS[preset] + n_steps * STEP_SECONDS[preset]
