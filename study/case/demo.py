"""The real patient and the virtual cohort that come with the package."""

import importlib.resources
import pathlib


def demo_case_path() -> pathlib.Path:
    """Case file of the bundled patient; its licence and citation lie beside it."""
    return pathlib.Path(str(importlib.resources.files("study"))) / "data/ivus_aaoca/case.toml"


def demo_cohort_path() -> pathlib.Path:
    """Folder of the virtual cohort; how it was made is said in its README."""
    return pathlib.Path(str(importlib.resources.files("study"))) / "data/virtual_cohort"
