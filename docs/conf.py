"""Sphinx: `python -m sphinx -W docs docs/_build` makes the pages and runs the examples."""

from importlib.metadata import version as installed

import pyvista

pyvista.OFF_SCREEN = True
pyvista.BUILDING_GALLERY = True

project = "bulgefit"
author = "the authors of bulgefit"
release = version = installed("bulgefit")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx_gallery.gen_gallery",
]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "own_package", "examples"]
autodoc_typehints = "none"  # the docstrings say types, shapes and units
html_theme = "furo"
html_title = "bulgefit"

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/plot_",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("matplotlib", "pyvista"),
    "abort_on_example_error": True,
    "show_memory": False,
    "download_all_examples": False,
}
