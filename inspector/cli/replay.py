"""`inspector replay`: a recording inspected as if it came from the camera."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inspector.cli.options import FalseRejectsOption, PolicyOption, TopicOption, judging
from inspector.cli.terminal import progress, warn

if TYPE_CHECKING:
    from inspector.locations import Location
    from inspector.recording import SweepReader
    from inspector.replay import Replayed
    from models.appearance import Appearance
    from models.recognition import Other
    from models.verdict import Policy

NOT_OK = 3


def replay(
    sweep: Annotated[str, typer.Argument(metavar="SWEEP.mcap", help="The recording, or its URL.")],
    *,
    appearance: Annotated[str, typer.Option(metavar="PART.appearance", help="What `learn` wrote, or its URL.")],
    json: Annotated[Path | None, typer.Option(metavar="RESULT.json", help="New file for the whole result.")] = None,
    mcap: Annotated[
        Path | None, typer.Option(metavar="SCORED.mcap", help="New recording with scores and boxes, for Foxglove.")
    ] = None,
    filmstrip: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for a picture per deviation: expected, seen, difference.")
    ] = None,
    policy: PolicyOption = None,
    false_rejects: FalseRejectsOption = None,
    other: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="[NAME=]OTHER.appearance", help="Another part, to be named where this is one; may be repeated."
        ),
    ] = None,
    topic: TopicOption = None,
    fail_on_ng: Annotated[bool, typer.Option("--fail-on-ng", help="Exit 3 on a verdict other than OK.")] = False,
) -> None:
    """Inspect a recording. The same recording, appearance and policy give the same digest.

    Example: inspector replay part-0042.mcap --appearance board.appearance --json part-0042.json
    """
    from inspector.files import refuse_taken
    from inspector.filmstrip import refuse_strips
    from inspector.learner import load_appearance
    from inspector.locations import to_location
    from inspector.others import Others
    from inspector.recording import SweepReader
    from inspector.result_json import write_result
    from models.verdict import Judgement

    for out in (json, mcap):
        if out is not None:
            refuse_taken(out)
    named = to_location(sweep)
    if filmstrip is not None:
        refuse_strips(filmstrip, named.stem)
    settings = judging(policy, false_rejects)
    recording, learnt = SweepReader(named, topic=topic), load_appearance(appearance)
    others = Others().of(_named(other or []))
    replayed = _replayed(recording, learnt, settings, mcap, others)
    if json is not None:
        write_result(json, _record(replayed, learnt, settings))
    _print(replayed, named)
    if filmstrip is not None:
        _write_filmstrips(filmstrip, recording, learnt, replayed, named.stem)
    if fail_on_ng and replayed.result.verdict is not Judgement.OK:
        raise typer.Exit(NOT_OK)


def _named(paths: Sequence[Path]) -> dict[str, Path]:
    """Files of other parts by their names, which are those of the files where none is given before a `=`."""
    parts: dict[str, Path] = {}
    for path in paths:
        name, _, file = ("", "", path) if path.exists() else str(path).rpartition("=")
        if (name := name or path.stem) in parts:
            raise typer.BadParameter(f"{name!r} names two parts; NAME=OTHER.appearance names one otherwise")
        parts[name] = Path(file)
    return parts


def _replayed(
    recording: SweepReader, appearance: Appearance, policy: Policy, mcap: Path | None, others: Sequence[Other]
) -> Replayed:
    """Replay with progress, by the number of frames that the recording announces."""
    from inspector.recording import count_frames
    from inspector.replay import replay as replay_recording
    from models.frame import Frame
    from models.verdict import ScoredFrame

    total = count_frames(recording.path)
    with progress("inspecting") as share:

        def on_scored(frame: Frame, scored: ScoredFrame) -> None:
            if total:
                share((scored.index + 1) / total)

        return replay_recording(
            recording, appearance, policy, on_scored=on_scored, scored_recording=mcap, others=others
        )


def _record(replayed: Replayed, appearance: Appearance, policy: Policy) -> dict[str, object]:
    from inspector.result_json import result_record
    from models.limits import promise

    promised = promise(appearance.peaks, policy.false_rejects)
    return result_record(replayed.result, replayed.facts, is_simulated=True, promise=promised)


def _print(replayed: Replayed, sweep: Location) -> None:
    from inspector.report import sentences

    for loss in replayed.losses:
        warn(f"{sweep}: {loss}")
    print(f"{sweep}: {replayed.result.verdict}")
    for line in sentences(replayed.result):
        print(f"  {line}")


def _write_filmstrips(
    folder: Path, recording: SweepReader, appearance: Appearance, replayed: Replayed, name: str
) -> None:
    from inspector.filmstrip import write_filmstrips

    for path in write_filmstrips(folder, recording, appearance, replayed.result, name):
        print(f"  {path}")
