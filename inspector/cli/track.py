"""`inspector track`: where the part is in every frame of a camera or a recording; a simulated hand that follows it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inspector.cli.options import TopicOption
from inspector.cli.terminal import count, duration, progress, status, stopped_by_signals, warn

if TYPE_CHECKING:
    from inspector.cameras.simulated import SimulatedCamera
    from models.frame import Frame
    from models.tracking import Tracked
    from models.workspace import Workspace

    Said = Callable[[int, Tracked, Workspace], None]

SIMULATED = "simulated:?size=160x120"


def track(
    source: Annotated[
        str | None, typer.Argument(metavar="SOURCE", help="A camera's url, or a recording; with --simulate a url.")
    ] = None,
    *,
    workspace: Annotated[
        Path | None, typer.Option(metavar="PART.workspace", help="What `workspace learn` wrote.")
    ] = None,
    json: Annotated[
        str | None, typer.Option(metavar="OUT.jsonl", help="New file for a line of JSON per frame; - for stdout.")
    ] = None,
    frames: Annotated[int | None, typer.Option(parser=count, metavar="N", help="Stop after so many frames.")] = None,
    seconds: Annotated[
        float | None, typer.Option(parser=duration, metavar="N", help="Stop after so many seconds, by the frames.")
    ] = None,
    topic: TopicOption = None,
    simulate: Annotated[
        str | None, typer.Option(metavar="circle|path", help="A hand follows the simulated part on such a course.")
    ] = None,
    speed: Annotated[
        float, typer.Option(metavar="REACHES", help="Simulated: of the part, per frame; a reach is what was learnt.")
    ] = 0.2,
    latency: Annotated[
        int, typer.Option(metavar="FRAMES", min=0, max=30, help="Simulated: from a picture to the hand being told.")
    ] = 1,
    cover: Annotated[
        str | None, typer.Option(metavar="FROM:TO", help="Simulated: frames in which the camera is covered.")
    ] = None,
) -> None:
    """Track a part: where it is in every frame, how fast it goes, when it is lost and found again. Ctrl-C ends it.

    Example: inspector track opencv:0 --workspace part.workspace --json tracked.jsonl

    Example: inspector track --simulate circle --speed 0.3 --cover 100:110
    """
    from inspector.files import refuse_taken

    if (simulate is None) == (workspace is None):
        raise typer.BadParameter("either --workspace with a SOURCE, or --simulate, which learns its own")
    if json is not None and json != "-":
        refuse_taken(Path(json))
    if simulate is not None:
        _check(simulate, speed)
        covered = _covered(cover)
        _follow(source or SIMULATED, simulate, speed, frames or 300, latency=latency, covered=covered, json=json)
    elif source is None or workspace is None:
        raise typer.BadParameter("--workspace needs a SOURCE: a camera's url, or a recording")
    else:
        _track(source, workspace, topic, json=json, frames=frames, seconds=seconds)


def _track(
    source: str, path: Path, topic: str | None, *, json: str | None, frames: int | None, seconds: float | None
) -> None:
    from inspector.tracking import TrackingSummary
    from inspector.tracking import track as tracked_frames
    from inspector.workspaces import load_workspace

    learnt, summary = load_workspace(path), TrackingSummary()
    with (
        _opened(source, topic) as delivered,
        stopped_by_signals() as stop,
        status("tracking") as say,
        _told(json) as tell,
    ):
        first = None
        for frame, tracked in tracked_frames(delivered, learnt):
            first = frame.t_ns if first is None else first
            summary = summary.with_frame(tracked)
            tell(frame.sequence, tracked, learnt)
            say(summary.sentence())
            if stop.is_set() or summary.frames == frames or (seconds and frame.t_ns - first >= seconds * 1e9):
                break
    _closing(json, f"{source}: {summary.sentence()}")


@contextmanager
def _opened(source: str, topic: str | None) -> Generator[Iterable[Frame]]:
    """The frames of a camera or of a recording, whose losses are told in the end."""
    from inspector.cameras import CAMERAS, open_camera

    if source.partition(":")[0] in CAMERAS:
        with open_camera(source) as camera:
            yield camera.frames()
    else:
        from inspector.recording import SweepReader

        reader = SweepReader(Path(source), topic=topic)
        yield reader
        for loss in reader.losses:
            warn(f"{source}: {loss}")


def _follow(url: str, name: str, speed: float, frames: int, *, latency: int, covered: range, json: str | None) -> None:
    from inspector.following import COURSES, follow, learn_displacements
    from inspector.tracking import TrackingSummary

    camera = _simulated(url)
    with progress("learning") as share:
        learnt = learn_displacements(camera, share)
    summary, errors = TrackingSummary(), list[float]()
    with stopped_by_signals() as stop, progress("following") as share, _told(json) as tell:
        for one in follow(camera, learnt, COURSES[name](speed), frames, latency=latency, covered=covered):
            summary = summary.with_frame(one.tracked)
            errors.append(one.error)
            tell(one.frame.sequence, one.tracked, learnt)
            share(summary.frames / frames)
            if stop.is_set():
                break
    reach, mean = learnt.reach("part")[0], sum(errors) / len(errors)
    _closing(json, f"{name} at {speed:g} reaches per frame, a reach is {reach:g} px: {summary.sentence()}")
    _closing(json, f"  off by {mean:.3f} reaches in the mean, {max(errors):.3f} at most")


def _check(name: str, speed: float) -> None:
    from inspector.following import COURSES

    if name not in COURSES:
        raise typer.BadParameter(f"--simulate {name!r} is not allowed; allowed is {' or '.join(COURSES)}")
    if not 0 < speed <= 10:
        raise typer.BadParameter(f"--speed {speed:g} is not allowed; allowed is above 0, to 10 reaches per frame")


def _simulated(url: str) -> SimulatedCamera:
    from inspector.cameras import open_camera
    from inspector.cameras.simulated import SimulatedCamera

    camera = open_camera(url)
    if not isinstance(camera, SimulatedCamera):
        camera.close()
        raise typer.BadParameter(f"--simulate does not go with {url!r}; allowed is a url that begins with simulated:")
    return camera


def _covered(text: str | None) -> range:
    if text is None:
        return range(0)
    start, mark, end = text.partition(":")
    if not (mark and start.isdecimal() and end.isdecimal() and int(start) < int(end)):
        raise typer.BadParameter(f"--cover {text!r} is not allowed; allowed is FROM:TO, as in 100:110")
    return range(int(start), int(end))


@contextmanager
def _told(json: str | None) -> Generator[Said]:
    """What is done with each frame: a line of JSON, or a line in words whenever something changes."""
    changes = _Changes()
    if json is None:
        yield changes.tell
    elif json == "-":
        yield lambda number, tracked, learnt: print(_line(number, tracked, learnt), flush=True)
    else:
        from inspector.files import arriving

        with arriving(Path(json)) as draft, draft.open("w", encoding="utf-8") as file:

            def write(number: int, tracked: Tracked, learnt: Workspace) -> None:
                file.write(_line(number, tracked, learnt) + "\n")
                changes.tell(number, tracked, learnt)

            yield write


def _line(number: int, tracked: Tracked, learnt: Workspace) -> str:
    from json import dumps

    from inspector.tracking import tracked_record

    return dumps(tracked_record(number, tracked, learnt))


class _Changes:
    """A line in words when the part is found, lost, or found again."""

    def __init__(self) -> None:
        self._state = "searching"

    def tell(self, number: int, tracked: Tracked, learnt: Workspace) -> None:
        before, self._state = self._state, tracked.state
        if tracked.state == "lost" and before != "lost":
            print(f"frame {number}: {tracked.object} is lost")
        elif tracked.state == "recovered" or (tracked.state == "tracking" and before == "searching"):
            again = " again" if tracked.state == "recovered" else ""
            places = zip(learnt.parameters, tracked.place or (), strict=False)
            where = ", ".join(f"{parameter.name} {value:.4g}" for parameter, value in places)
            print(f"frame {number}: {tracked.object} is found{again}, {where}")


def _closing(json: str | None, said: str) -> None:
    """The end is a result like the others, unless stdout is for programs."""
    print(said, file=sys.stderr if json == "-" else sys.stdout)
