"""`inspector record`: a camera's sweep into a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inspector.cli.terminal import count, duration, status, stopped_by_signals, warn

if TYPE_CHECKING:
    from inspector.recorder import RecordingSummary


def record(
    *,
    camera: Annotated[
        str, typer.Option(metavar="URL", help="simulated:?part=board, folder:PATH, opencv:0, opencv:rtsp://...")
    ],
    out: Annotated[Path, typer.Option(metavar="SWEEP.mcap", help="New file for the recording.")],
    seconds: Annotated[
        float | None, typer.Option(parser=duration, metavar="N", help="Stop after so many seconds of the sweep.")
    ] = None,
    frames: Annotated[int | None, typer.Option(parser=count, metavar="N", help="Stop after so many frames.")] = None,
    product: Annotated[str | None, typer.Option(metavar="ID", help="The kind of part, kept in the recording.")] = None,
    part: Annotated[str | None, typer.Option(metavar="ID", help="The serial number, kept in the recording.")] = None,
) -> None:
    """Record one sweep. Ctrl-C ends it and closes the file properly.

    Example: inspector record --camera "simulated:?part=board" --out golden.mcap --product board
    """
    from inspector.cameras import open_camera
    from inspector.cameras.base import waits
    from inspector.recorder import record as record_sweep

    with open_camera(camera) as source, stopped_by_signals() as stop, status("recording") as say:
        summary = record_sweep(
            source, out, seconds=seconds, frames=frames, product_id=product, part_id=part,
            lossless=waits(camera), on_progress=lambda so_far: say(_counted(so_far)), stop=stop,
        )  # fmt: skip
    if summary.drops:
        warn(f"{summary.drops} frames came faster than the disk took them; they are lost, and counted in {out}")
    print(f"{out}: {_counted(summary)}")


def _counted(summary: RecordingSummary) -> str:
    """The figures of a recording, in words."""
    lost = f", {summary.drops} dropped" if summary.drops else ""
    return f"{summary.frames} frames{lost}, {summary.seconds:.1f} s, {summary.bytes / 1e6:.1f} MB"
