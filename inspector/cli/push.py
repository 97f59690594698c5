"""`inspector push`: a recording streamed to a service, as a line would do it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from inspector.cli.options import TopicOption
from inspector.cli.replay import NOT_OK
from inspector.cli.terminal import progress, warn

if TYPE_CHECKING:
    from inspector.client import AbstractInspection
    from inspector.recording import SweepReader

INTERRUPTED = 130


def push(
    sweep: Annotated[Path, typer.Argument(metavar="SWEEP.mcap", help="The recording.")],
    *,
    url: Annotated[str, typer.Option(metavar="URL", help="The service.")] = "http://127.0.0.1:8000",
    product: Annotated[str, typer.Option(metavar="ID", help="The kind of part, as the service knows it.")],
    part: Annotated[str, typer.Option(metavar="ID", help="The serial number.")],
    recipe: Annotated[str | None, typer.Option(metavar="ID", help="Other than the active one.")] = None,
    transport: Annotated[Literal["ws", "rest"], typer.Option(help="A WebSocket, or a request for each frame.")] = "ws",
    pace: Annotated[
        Literal["real", "flat-out"], typer.Option(help="As it was recorded, or as fast as the service takes it.")
    ] = "real",
    json: Annotated[Path | None, typer.Option(metavar="RESULT.json", help="New file for the whole result.")] = None,
    token: Annotated[
        str | None, typer.Option(envvar="INSPECTOR_TOKEN", metavar="TOKEN", help="Where the service asks for one.")
    ] = None,
    topic: TopicOption = None,
    fail_on_ng: Annotated[bool, typer.Option("--fail-on-ng", help="Exit 3 on a verdict other than OK.")] = False,
) -> None:
    """Stream a recording to a service and print its verdict. Ctrl-C aborts the inspection.

    Example: inspector push part-0042.mcap --url http://127.0.0.1:8000 --product plate --part 0042
    """
    from inspector.client import Client
    from inspector.files import refuse_taken
    from inspector.recording import SweepReader
    from inspector.report import sentences
    from inspector.result_json import result_of, write_result
    from models.verdict import Judgement

    if json is not None:
        refuse_taken(json)
    recording, heard = SweepReader(sweep, topic=topic), _Heard()
    # A recording that cannot be read is told before anything is begun.
    _ = recording.topic
    with (
        Client(url, token) as client,
        client.begin(product, part, recipe_id=recipe, transport=transport, on_message=heard) as inspection,
    ):
        record = _pushed(recording, inspection, pace)
    if json is not None:
        write_result(json, record)
    for loss in (*recording.losses, *heard.losses()):
        warn(f"{sweep}: {loss}")
    result = result_of(record)
    print(f"{sweep}: {result.verdict}")
    for line in sentences(result):
        print(f"  {line}")
    if fail_on_ng and result.verdict is not Judgement.OK:
        raise typer.Exit(NOT_OK)


class _Heard:
    """What the service said of frames that it did not score."""

    def __init__(self) -> None:
        self._why: dict[str, list[str]] = {"refused": [], "dropped": []}

    def __call__(self, message: dict[str, Any]) -> None:
        if message["kind"] in self._why:
            self._why[message["kind"]].append(message["why"])

    def losses(self) -> list[str]:
        return [
            f"{len(why)} frames were {kind} by the service; the first: {why[0]}"
            for kind, why in self._why.items()
            if why
        ]


def _pushed(recording: SweepReader, inspection: AbstractInspection, pace: str) -> dict[str, Any]:
    import time

    from inspector.client import paced
    from inspector.recording import count_frames

    total = count_frames(recording.path)
    frames = paced(recording, time.monotonic, inspection.wait) if pace == "real" else recording
    with progress("inspecting") as share:
        try:
            for number, frame in enumerate(frames, start=1):
                inspection.send(frame)
                if total:
                    share(number / total)
            return inspection.conclude()
        except KeyboardInterrupt:
            inspection.abort("interrupted at the line")
            warn(f"interrupted; inspection {inspection.inspection_id} is aborted at the service")
            raise typer.Exit(INTERRUPTED) from None
