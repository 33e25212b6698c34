"""The real patient that comes with the package."""

import importlib.resources
import pathlib


def demo_case_path() -> pathlib.Path:
    """Case file of the bundled patient; its licence and citation lie beside it."""
    return pathlib.Path(str(importlib.resources.files("study"))) / "data/ivus_aaoca/case.toml"
