"""Sphinx: `python -m sphinx -W docs docs/_build` makes the pages and runs the examples."""

from importlib.metadata import version as installed

import pyvista
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

pyvista.OFF_SCREEN = True
pyvista.BUILDING_GALLERY = True  # so that its scraper finds what was shown

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
suppress_warnings = ["config.cache"]  # the scraper below is a function, which nobody can cache
html_theme = "furo"
html_title = "bulgefit"


def returned_figures(block, block_vars, gallery_conf):
    """Figures that plot functions returned: they belong to no window, as pyplot's do."""
    seen = block_vars.setdefault("seen_figures", set())
    written = []
    for value in block_vars["example_globals"].values():
        if isinstance(value, Figure) and not hasattr(value, "number") and id(value) not in seen:
            seen.add(id(value))
            written.append(next(block_vars["image_path_iterator"]))
            value.savefig(written[-1], dpi=100)
    return figure_rst(written, gallery_conf["src_dir"])


sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/plot_",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("matplotlib", returned_figures, "pyvista"),
    "abort_on_example_error": True,
    "show_memory": False,
    "download_all_examples": False,
}
