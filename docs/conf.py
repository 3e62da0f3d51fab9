"""How the documentation is built: `make docs`; without the gallery `make docs SPHINXOPTS="-D plot_gallery=0"`."""

import os
import sys
import tempfile
from pathlib import Path

from sphinx.application import Sphinx

from truepose import __version__

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_extensions"), str(HERE.parent / "tools")]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
STATE = tempfile.TemporaryDirectory(prefix="truepose-docs-")  # what pages correct is not remembered
os.environ["TRUEPOSE_STATE"] = STATE.name


def setup(app: Sphinx) -> None:
    """Let pages be read in several processes."""
    app.extensions["sphinx-mathjax-offline"].parallel_read_safe = True  # it copies files at the end, and says nothing


project, author, project_copyright = "truepose", "The truepose developers", "The truepose developers"
version = release = __version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "sphinx_gallery.gen_gallery",
    "public_names",
    "rooms",
    "screens",
    "shown_commands",
    "theory_links",
]
exclude_patterns = [
    "_build",
    "gallery/*.ipynb",
    "gallery/*.py",
    "gallery/backreferences",
    "how-to/files",
    "validation/*/table.md",
    "**sg_execution_times.rst",
]
default_role = "py:obj"
language = "en"

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
mathjax_path = "mathjax/tex-chtml.js"  # from sphinx-mathjax-offline: a page asks no server but its own

autodoc_default_options = {  # scikit-learn adds these to every estimator
    "exclude-members": "set_fit_request, set_predict_request, set_score_request, set_partial_fit_request"
}
toc_object_entries_show_parents = "hide"
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # types, shapes and units are in the docstrings
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

sphinx_gallery_conf = {
    "examples_dirs": str(HERE.parent / "examples"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"/",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "remove_config_comments": True,
    "capture_repr": (),
    "show_memory": False,
    "abort_on_example_error": False,
    "default_thumb_file": None,
    "min_reported_time": 5,
}

html_theme = "furo"
html_title = f"truepose {__version__}"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_theme_options = {"footer_icons": []}
html_copy_source = False
html_show_sphinx = False
