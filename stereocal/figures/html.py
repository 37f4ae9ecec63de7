"""The parts of an HTML report that holds everything in one file and opens without a network."""

from collections.abc import Mapping, Sequence
from html import escape

import pandas as pd
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

STYLE = """
:root { color-scheme: light dark; --ink: #1b2631; --page: #ffffff; --rule: #c9d0d6;
  --shade: #f3f5f7; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6ebf0; --page: #12181e; --rule: #3b4752; --shade: #1c252e; }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 1140px; margin: 0 auto; padding: 16px; }
h1 { font-size: 1.7rem; line-height: 1.25; } h2 { font-size: 1.25rem; margin-top: 2rem; }
.answer { font-size: 1.1rem; padding: 12px 16px; background: var(--shade);
  border-left: 4px solid #1f83c4; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.92rem; }
th, td { padding: 4px 10px; border-bottom: 1px solid var(--rule); text-align: left;
  vertical-align: top; overflow-wrap: break-word; }
td { font-variant-numeric: tabular-nums; }
.data td:not(:last-child) { white-space: nowrap; }
.data td:last-child { font-family: monospace; overflow-wrap: anywhere; min-width: 20ch; }
.main-svg > g:not(.hoverlayer) text { fill: var(--ink) !important; }
.textpoint text { paint-order: stroke; stroke: var(--page); stroke-width: 3px; }
.narrow { display: none; }
.sets { display: grid; grid-template-columns: 1fr 1fr; gap: 16px; }
.sets > div { min-width: 0; }
@media screen and (max-width: 759px) {
  .wide { display: none; } .narrow { display: block; } .sets { grid-template-columns: 1fr; }
}
@page { size: A4 landscape; margin: 12mm; }
@media print {
  :root { --ink: #000000; --page: #ffffff; --rule: #999999; --shade: #ffffff; }
  main { max-width: none; padding: 0; }
  .plot { zoom: 0.72; } .plot, tr { break-inside: avoid; } h2 { break-after: avoid; }
}
"""


def html_page(title: str, answer: str, sections: Mapping[str, str]) -> str:
    """The text of the file, with Plotly's script; the answer stands below the title.

    Args:
        sections: HTML by title; empty ones are left out.
    """
    parts = [f'<h1>{escape(title)}</h1>\n<p class="answer">{escape(answer)}</p>']
    parts += [
        f"<section>\n<h2>{escape(name)}</h2>\n{content}\n</section>"
        for name, content in sections.items()
        if content
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n"
        f"<script>{get_plotlyjs()}</script>\n</head>\n<body>\n<main>\n"
        + "\n".join(parts)
        + "\n</main>\n</body>\n</html>\n"
    )


def paragraphs(*texts: str) -> str:
    return "\n".join(f"<p>{escape(text)}</p>" for text in texts)


def html_list(texts: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(text)}</li>' for text in texts)}</ul>" if texts else ""


def html_plot(figure: go.Figure, words: str, kind: str = "plot") -> str:
    drawn = figure.to_html(
        full_html=False,
        include_plotlyjs=False,
        include_mathjax=False,
        config={"responsive": True, "displayModeBar": False},
    )
    return f'<div class="{kind}" role="img" aria-label="{escape(words)}">{drawn}</div>'


def html_figure(figure: go.Figure, words: str) -> str:
    """A figure with its words."""
    return html_plot(figure, words) + paragraphs(words)


def html_table(table: pd.DataFrame, kind: str = "plain") -> str:
    """A table, escaped; of the kind `data`, the last column is a digest."""
    columns = (table.index.name or "", *table.columns)
    heads = "".join(f'<th scope="col">{escape(str(column))}</th>' for column in columns)
    rows = [
        f'<tr><th scope="row">{escape(str(name))}</th>'
        + "".join(f"<td>{escape(str(cell))}</td>" for cell in cells)
        + "</tr>"
        for name, cells in zip(table.index, table.to_numpy(), strict=True)
    ]
    return (
        f'<div class="scroll" tabindex="0"><table class="{kind}"><thead><tr>{heads}</tr></thead>\n'
        "<tbody>" + "\n".join(rows) + "</tbody></table></div>"
    )
