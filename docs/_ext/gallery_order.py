"""Order of tutorials and examples in the gallery."""

ORDER = (
    "first_report", "from_ultrasound", "from_surface", "tube_with_windkessel", "own_loss",
    "ten_thousand_patients", "diagnose_record", "cohort_on_cluster",
    "outlet", "calibrate_patient", "sweep_cohort", "ffr_gradient", "ffr_interval",
    "elastic_tube", "wall_alone", "mesh_from_contours", "fsi_gradient", "alpha_in_loop",
    "wall_and_blood",
)  # fmt: skip


class TutorialOrder:
    """Sorts files as `ORDER` lists them; one that is not listed raises."""

    def __init__(self, folder: str):
        self.folder = folder

    def __call__(self, name: str) -> int:
        """Place of a file."""
        return ORDER.index(name.removesuffix(".py"))

    def __repr__(self) -> str:
        """The same from build to build."""
        return "<TutorialOrder>"
