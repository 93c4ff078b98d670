"""Sphinx configuration of the documentation site.

``sphinx-build -W --keep-going docs docs/_build/html`` builds it, without a network: formulas become
MathML, the search is Sphinx's own, and no other project's inventory is read.
"""

from __future__ import annotations

import sys
from pathlib import Path

import hillsphere

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "Hillsphere"
author = "The Hillsphere developers"
version = release = hillsphere.__version__

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "mathml",
    "component_reference",
    "module_reference",
]
exclude_patterns = ["_build"]
suppress_warnings = [
    "ref.footnote",  # the docstring of a module lists the sources that its functions cite
]

# Pages: Markdown, with directives and formulas between dollar signs.
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
default_role = "py:obj"  # `name` in a docstring is a link if the name is documented
highlight_language = "none"

# Tutorials are run anew whenever a page changed; a page that needs more than a minute is not run.
nb_execution_mode = "cache"
nb_execution_timeout = 120  # s; twice what a page may take, for a machine that is busy
nb_execution_raise_on_error = True
nb_execution_in_temp = True  # runs write their directories there
nb_merge_streams = True

# Docstrings.
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # numpydoc's sections state types with shapes and units
autosummary_generate = False
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

html_theme = "pydata_sphinx_theme"
html_title = "Hillsphere"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_math_renderer = "mathml"
html_context = {"default_mode": "auto"}
html_theme_options = {
    "header_links_before_dropdown": 6,
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
project_copyright = "The Hillsphere developers, BSD-3-Clause"
