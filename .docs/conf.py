"""Configuration of Sphinx for the book. `build.py` assembles the sources and calls Sphinx."""

from __future__ import annotations

from importlib.metadata import version as version_of

project = "worm3d"
release = version = version_of("worm3d")

extensions = ["myst_nb", "sphinx.ext.mathjax"]
root_doc = "index"
nitpicky = True

myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_dmath_double_inline = True

nb_execution_mode = "force"
nb_execution_in_temp = True  # cells write files, and two tutorials run at once
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_merge_streams = True
nb_ipywidgets_js: dict[str, dict[str, str]] = {}  # would be loaded from the network

mathjax_path = "mathjax/tex-svg-full.js"  # copied by build.py: formulas need no network
mathjax3_config = {"options": {"enableMenu": False}}

html_theme = "furo"
html_title = "worm3d"
html_static_path = ["_static"]
html_css_files = ["custom.css"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#a3341f", "color-brand-content": "#1f5fa3"},
    "dark_css_variables": {"color-brand-primary": "#f08a72", "color-brand-content": "#7db4f0"},
    "top_of_page_buttons": [],
}
