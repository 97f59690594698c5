"""Tables as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


def number(said: object) -> str:
    """A cell on the right edge."""
    return f'<td class="number">{escape(str(said))}</td>'


def table(
    heads: Sequence[str], rows: Iterable[Sequence[str]], caption: str, numbers: int | tuple[int, ...] = ()
) -> str:
    """Rows of cells that are HTML already; `numbers` are the columns on the right edge, or how many there are last."""
    right = range(len(heads) - numbers, len(heads)) if isinstance(numbers, int) else numbers
    head = "".join(
        f'<th scope="col"{" class=number" if column in right else ""}>{name}</th>' for column, name in enumerate(heads)
    )
    thead = f"<thead><tr>{head}</tr></thead>" if any(heads) else ""
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in rows)
    return f'<div class="wide"><table><caption>{caption}</caption>{thead}<tbody>{body}</tbody></table></div>'
