"""`inspector demo`: learn and inspect on a simulated line; no camera, no data, no network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inspector.cli.terminal import progress, warn

if TYPE_CHECKING:
    from inspector.demo import Demo, Row

_ENDING_SECONDS = 5.0
WIDTH = 120
"""Of the table, where stdout is no terminal."""


def demo(
    data: Annotated[
        Path | None, typer.Option(metavar="DIR", help="New folder for everything. [default: inspector-demo]")
    ] = None,
    part: Annotated[str, typer.Option(help="plate, board or casting, a design's number after it: board2")] = "plate",
    seed: Annotated[int, typer.Option(help="Other parts, other conditions, other places.")] = 1,
    serve: Annotated[bool, typer.Option("--serve", help="Then serve, with a line that sends part after part.")] = False,
    port: Annotated[int, typer.Option(metavar="N", help="Of the service; 0 takes a free one.")] = 8000,
) -> None:
    """Learn from two simulated golden sweeps, inspect good and defective parts, show the verdicts.

    Example: inspector demo --part board --data demo-board
    """
    from inspector.demo import run_demo
    from inspector.errors import OutputExists

    folder = data or free_name(Path("inspector-demo"))
    if folder.exists():
        raise OutputExists(folder)
    with progress("sweeping, learning, inspecting") as share:
        shown = run_demo(folder, part=part, seed=seed, progress=share)
    _print(shown)
    if serve:
        _serve(folder, part, port)
    if not shown.right:
        raise typer.Exit(1)


def _serve(folder: Path, part: str, port: int) -> None:
    """A service in the demo's folder, and a line that is its client, until Ctrl-C."""
    import threading

    from inspector.client import ClientError
    from inspector.demo_line import run_line
    from inspector.serving import serve
    from inspector.settings import read_settings

    stop = threading.Event()

    def line(url: str) -> None:
        try:
            run_line(
                url, folder, part, stop, on_verdict=lambda name, verdict: print(f"  {name}: {verdict}", flush=True)
            )
        except ClientError as error:
            # Ctrl-C ends the service first, and the line hears of it.
            if not stop.wait(_ENDING_SECONDS):
                warn(f"the demo's line has stopped: {error}")

    def begin(url: str) -> None:
        print(f"inspector serves at {url}; a line sends it part after part; Ctrl-C ends both", flush=True)
        threading.Thread(target=line, args=(url,), daemon=True).start()

    try:
        serve(read_settings(data=folder / "service", port=port, log_level="warning"), begin)
    finally:
        stop.set()


def free_name(wanted: Path) -> Path:
    """The name itself, or with the first number after it that makes it free: a demo can be run again and again."""
    path, number = wanted, 1
    while path.exists():
        number += 1
        path = wanted.with_name(f"{wanted.name}-{number}")
    return path


def _print(shown: Demo) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    if not console.is_terminal:
        console = Console(width=WIDTH)
    table = Table(title="Two golden sweeps learnt; each part below was never seen before", title_justify="left")
    for name in ("part", "verdict", "expected", "defect at s", "found at s", "score", ""):
        table.add_column(name, justify="right" if name == "score" else "left")
    for row in shown.rows:
        table.add_row(*_cells(row))
    console.print(table)
    right = sum(row.right for row in shown.rows)
    print(f"{right} of {len(shown.rows)} parts judged right, at the right place")
    print(f"a recording, replayed, gives the digest of its live inspection: {'yes' if shown.same_digest else 'NO'}")
    print(f"recordings, appearance, results, filmstrips: {shown.folder}")


def _cells(row: Row) -> list[str]:
    deviations = row.found or row.result.deviations
    places = ", ".join(f"{d.s_start:.2f}–{d.s_end:.2f}" for d in deviations)
    elsewhere = len(row.result.deviations) - len(row.found) if row.found else 0
    also = f" (and {elsewhere} elsewhere)" if elsewhere else ""
    peak = max((frame.score for frame in row.result.frames), default=0.0)
    colour = "green" if row.right else "red"
    return [
        row.sample.name,
        f"[bold {colour}]{row.result.verdict}[/]",
        row.expected.value,
        "" if row.planted is None else f"{row.planted:.3f}",
        places + also,
        f"{peak:.2f}",
        f"[{colour}]{'right' if row.right else 'WRONG'}[/]",
    ]
