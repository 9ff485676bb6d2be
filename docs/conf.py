"""How the site is built: Sphinx with MyST, by `./run docs`.

Sphinx, since it reads these pages as they are, takes the reference from the docstrings, checks every link and is the
field's common tool; nothing of the built site is fetched from elsewhere.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tools"), str(ROOT / "benchmarks")]

import error_page  # noqa: E402  (of tools, as the next three)
import gallery  # noqa: E402
import numbers_page  # noqa: E402
import reference  # noqa: E402

import flexmbd  # noqa: E402

project = "flexmbd"
author = "the authors of flexmbd"
release = version = flexmbd.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx-mathjax-offline",
]
source_suffix = {".md": "markdown"}
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
exclude_patterns = ["conf.py"]

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "bysource"
# System's methods are its own and those of what it is built on; those of Python's classes are not told.
autodoc_default_options = {"members": True, "inherited-members": "object,BaseException,Enum,Protocol,ArrayStruct"}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

suppress_warnings = ["ref.python"]  # of the attributes that many classes call by one name

html_theme = "furo"
html_title = f"flexmbd {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_domain_indices = False
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False


def plain(app, what, name, obj, options, lines):
    """Docstrings are plain text but for words in double backticks, and indented blocks after a colon are formulas."""
    block = None  # the indentation of the text before a block
    for k, line in enumerate(lines):
        depth = len(line) - len(line.lstrip())
        if block is not None and (not line.strip() or depth > block):
            continue
        block = None
        after = next((rest for rest in lines[k + 2 :] if rest.strip()), "")
        if line.endswith(":") and lines[k + 1 : k + 2] == [""] and len(after) - len(after.lstrip()) > depth:
            line, block = line + ":", depth
        parts = line.split("``")
        parts[::2] = [re.sub(r"([\\*|]|(?<=\w)_(?!\w))", r"\\\1", part) for part in parts[::2]]
        lines[k] = "``".join(parts)


def setup(app):
    """Before the sources are read write the pages of gallery, numbers, reference and errors; then copy the films."""

    def write_pages(app):
        gallery.write_pages(Path(app.srcdir) / "gallery", outputs=Path(app.config.gallery_outputs))
        numbers_page.write_pages(Path(app.srcdir) / "numbers")
        reference.write_pages(Path(app.srcdir) / "reference")
        error_page.write_page(Path(app.srcdir) / "errors.md")

    def copy_films(app, failure):
        if failure is None:
            gallery.copy_films(Path(app.srcdir) / "gallery", Path(app.outdir) / "gallery")

    app.add_config_value("gallery_outputs", str(gallery.OUTPUTS), "env", types=[str])
    app.connect("builder-inited", write_pages)
    app.connect("build-finished", copy_films)
    app.connect("autodoc-process-docstring", plain, priority=100)  # before napoleon
