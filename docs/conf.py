"""Sphinx configuration of the site: `make docs`. Warnings are errors, and nothing is fetched."""

import importlib.metadata
import pathlib
import sys

DOCS = pathlib.Path(__file__).parent
sys.path[:0] = [str(DOCS / "_ext"), str(DOCS.parent)]

project = "jaxfsi"
author = "The jaxfsi developers"
copyright = "The jaxfsi developers, Apache-2.0"
release = importlib.metadata.version("jaxfsi")
version = release

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_argparse_cli",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "benchmark_plot",
    "benchmark_table",
    "docstrings",
    "drawings",
    "katex_math",
    "public_data",
    "quick_names",
    "source_page",
]
exclude_patterns = ["_*", "**/GALLERY_HEADER.rst", "tutorials/*.py"]
suppress_warnings = [
    "config.cache",  # functions in the configuration of the gallery
]

# Markdown
myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

# API
autodoc_default_options = {"members": True, "undoc-members": False, "show-inheritance": True}
autodoc_member_order = "groupwise"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_custom_sections = [("Properties", "params_style")]
add_module_names = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
default_role = "py:obj"
nitpick_ignore_regex = [
    # Docstrings name private helpers and parameters in backticks: they stay plain code.
    (r"py:obj", r".*"),
    # Other packages: their inventories lie on the network.
    (r"py:.*", r"(jax|jaxlib|jaxtyping|numpy|np|equinox|eqx|scipy|optimistix|lineax|diffrax)\b.*"),
    (r"py:.*", r"(collections|concurrent|pathlib|os|argparse|types|typing|pydantic|enum)\b.*"),
    (r"py:.*", r"Array|ndarray|True|Number|Empty|By name"),
    # Shape strings of jaxtyping, choices of Literal, words before the colon of a "Returns:".
    (r"py:class", r"'.*|.*'|.* .*|abc\.ABC|False"),
    # Classes that annotations name and that are not public.
    (r"py:class", r"(lumped|calibration|diagnosis|study)\.[a-z_]\w*\.[\w.]+"),
    (r"py:class", r"jaxfsi\.\w+\.[a-z_]\w*\.[\w.]+"),
    (r"py:class", r"jaxfsi\.(mesh|mesh_parts|mesh_checks|opening|lumen|faces|contours)\.\w+"),
]

# Pages
html_theme = "furo"
html_title = "jaxfsi"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#9b1c31", "color-brand-content": "#9b1c31"},
    "dark_css_variables": {"color-brand-primary": "#f28b9b", "color-brand-content": "#f28b9b"},
    "footer_icons": [],
}
pygments_style = "tango"
pygments_dark_style = "monokai"

# Tutorials and examples, run by the build
sphinx_gallery_conf = {
    "examples_dirs": ["tutorials", "../examples"],
    "gallery_dirs": ["auto/tutorials", "auto/examples"],
    "filename_pattern": r"\.py$",
    "within_subsection_order": "gallery_order.TutorialOrder",
    "abort_on_example_error": True,
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 1e9,
    "plot_gallery": "True",
    "copyfile_regex": r"",
    "reset_modules": ("matplotlib",),
}
