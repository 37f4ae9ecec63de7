"""The two works that a paper cites, as BibTeX."""

from __future__ import annotations

from stereocal.version import __version__

PAPER, PROGRAM = "beschi2021", "stereocal"
"""Keys of the entries."""


def references_bib() -> bytes:
    """`references.bib`: the paper of the method, and the program with its version."""
    return f"""@misc{{{PAPER},
  author = {{Beschi, Riccardo and Feng, Xiao and Melillo, Stefania and Parisi, Leonardo and
            Postiglione, Lorena}},
  title = {{{{Stereo camera system calibration: the need of two sets of parameters}}}},
  year = {{2021}},
  eprint = {{2101.05725}},
  archivePrefix = {{arXiv}},
  url = {{https://arxiv.org/abs/2101.05725}},
}}

@software{{{PROGRAM},
  author = {{{{The developers of stereocal}}}},
  title = {{{{stereocal}}}},
  version = {{{__version__}}},
}}
""".encode()
