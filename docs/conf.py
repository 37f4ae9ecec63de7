"""The documentation site: `make docs` builds it from the Markdown of this folder.

Nothing is loaded from elsewhere, so the site can be read without a network: formulas are MathML,
which browsers draw themselves, and fonts are the reader's own.
"""

import sys
from pathlib import Path

from docutils.nodes import SkipNode, math, math_block
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import stereocal  # noqa: E402

project = "stereocal"
release = version = stereocal.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
nitpicky = True
# Types of NumPy, pandas and the standard library are described elsewhere.
nitpick_ignore_regex = [("py:.*", ".*")]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

default_role = "py:obj"
ARRAYS = ("FloatArray", "IntArray", "BoolArray")
autodoc_type_aliases = {"npt.ArrayLike": "ArrayLike", **dict(zip(ARRAYS, ARRAYS, strict=True))}
autodoc_member_order = "bysource"
python_maximum_signature_line_length = 80

html_theme = "furo"
html_title = "stereocal"
html_favicon = "../assets/icon.svg"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_show_copyright = html_show_sphinx = html_copy_source = html_show_sourcelink = False
html_math_renderer = "mathml"

OUTSIDE = {
    "../benchmarks/README.md": "benchmarks.md",
    "../sample_data/README.md": "sample_data.md",
    "../CHANGELOG.md": "changelog.md",
    "../CONTRIBUTING.md": "contributing.md",
}
"""Files outside this folder, and their pages: a link that works on a code host works here too."""


def link_to_pages(_app: Sphinx, _page: str, source: list[str]) -> None:
    """Links to files outside this folder, as links to the pages that show them."""
    for file, page in OUTSIDE.items():
        source[0] = source[0].replace(f"]({file}", f"]({page}")


def write_formula(writer: HTML5Translator, node: math | math_block) -> None:
    """Write a formula as MathML, in place of the node's own text."""
    display = "block" if isinstance(node, math_block) else "inline"
    writer.body.append(convert(node.astext(), display=display))
    raise SkipNode


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", link_to_pages)
    app.add_html_math_renderer("mathml", (write_formula, None), (write_formula, None))
