"""Small pieces of HTML; every text that goes in is escaped here."""

from collections.abc import Iterable
from collections.abc import Sequence
from html import escape

UNKNOWN = 'not known'


def number(value: float | None, unit: str = '') -> str:
    """Return a number with four digits and its unit; `UNKNOWN` for None."""
    if value is None:
        return UNKNOWN
    text = f'{value:,.0f}' if 1e4 <= abs(value) < 1e9 else f'{value:.4g}'
    return f'{text} {unit}'.rstrip()


def percent(share: float | None) -> str:
    """Return a share as per cent; `UNKNOWN` for None."""
    return UNKNOWN if share is None else f'{100 * share:.3g} %'


def paragraph(text: str, kind: str = '') -> str:
    """Return a paragraph, of a class if one is named."""
    attribute = f' class="{kind}"' if kind else ''
    return f'<p{attribute}>{escape(text)}</p>'


def table(head: Sequence[str], rows: Iterable[Sequence[str | None]]) -> str:
    """Return a table whose first column names the rows."""
    cells = ''.join(f'<th scope="col">{escape(text)}</th>' for text in head)
    return (
        f'<div class="scroll"><table><thead><tr>{cells}</tr></thead>'
        f'<tbody>{"".join(map(_row, rows))}</tbody></table></div>'
    )


def definition(rows: Iterable[tuple[str, str]], kind: str) -> str:
    """Return pairs of name and value."""
    pairs = ''.join(
        f'<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>' for name, value in rows
    )
    return f'<dl class="{kind}">{pairs}</dl>'


def figures(drawn: Iterable[str]) -> str:
    """Return figures, each an SVG element that is taken as it is."""
    return ''.join(f'<figure>{svg}</figure>' for svg in drawn)


def pair(left: str, right: str) -> str:
    """Return two pieces side by side where there is room."""
    return f'<div class="pair"><div>{left}</div><div>{right}</div></div>'


def _row(row: Sequence[str | None]) -> str:
    first, *others = (UNKNOWN if text is None else text for text in row)
    cells = ''.join(f'<td>{escape(text)}</td>' for text in others)
    return f'<tr><th scope="row">{escape(first)}</th>{cells}</tr>'
