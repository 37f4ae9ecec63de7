"""The two works that a paper cites, as BibTeX."""

from __future__ import annotations

import stereocal

PAPER, PROGRAM = "beschi_two_sets", "stereocal"
"""Keys of the entries."""


def references_bib() -> bytes:
    """`references.bib`: the paper of the method, and the program with its version."""
    return f"""% Add journal, year and DOI of the version that you cite.
@misc{{{PAPER},
  author = {{Beschi, Riccardo and Feng, Xiao and Melillo, Stefania and Parisi, Leonardo
            and Postiglione, Lorena}},
  title = {{{{Stereo camera system calibration: the need of two sets of parameters}}}},
}}

@software{{{PROGRAM},
  author = {{{{The stereocal authors}}}},
  title = {{{{stereocal}}: calibration of stereo camera systems from a bar}},
  version = {{{stereocal.__version__}}},
}}
""".encode()
