"""A hand that follows a moving part: the loop closed on the simulated camera, with the latency that a loop has."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from inspector.cameras.simulated import SimulatedCamera
from inspector.cameras.simulated.canvas import HEIGHT, WIDTH
from inspector.cameras.simulated.render import Pose
from models.frame import Frame
from models.tracking import Tracked, aim, begin, step
from models.workspace import LabelledPicture, Parameter, Workspace, learn_workspace

REACH = 32.0
"""Learnt to either side, px of a picture 320 wide."""
COUNT = 9
"""Places learnt of each displacement."""
BEND = 5.0
"""Radius of the circle, and of the tightest bend of the path, in reaches."""
TOP_SPEED = 0.4
"""Reaches per frame up to which a part that sets off at once is not lost with one frame of latency, and is found again
when it was covered for ten frames. From half a reach on, it leaves what was learnt before any hand can know of it:
until its velocity is known, and the hand is where that sends it, the part has gone as far as two frames take it."""
_GRAIN = 8
"""Steps per frame in which a path is drawn."""
_PAST = 1 << 20
"""Number of the first picture that is learnt from: none of a loop has its noise."""
Course = Callable[[int], Float64[np.ndarray, "n 2"]]
"""Where the part is in each of the first n frames, in reaches from where it begins."""


def circle(speed: float, bend: float = BEND) -> Course:
    """Round a circle at that many reaches per frame.

    >>> circle(0.5, 1.0)(2).round(2).tolist()
    [[0.0, 0.0], [-0.12, 0.48]]
    """

    def at(n: int) -> Float64[np.ndarray, "n 2"]:
        angle = np.arange(n) * speed / bend
        return bend * np.stack([np.cos(angle) - 1, np.sin(angle)], axis=1)

    return at


def path(speed: float, bend: float = BEND, seed: int = 1) -> Course:
    """A smooth path of chance at that speed: its curvature goes to and fro, and is 1 / bend where it bends most."""

    def at(n: int) -> Float64[np.ndarray, "n 2"]:
        rng = np.random.default_rng([seed, 5])
        way = np.arange(n * _GRAIN) * speed / _GRAIN
        waves = rng.uniform(0.2, 1.0, 6) / bend, rng.standard_normal(6), rng.uniform(0, 2 * np.pi, 6)
        curvature = sum(size * np.sin(number * way + phase) for number, size, phase in zip(*waves, strict=True))
        curvature = curvature / (bend * np.abs(curvature).max())
        heading = rng.uniform(0, 2 * np.pi) + np.cumsum(curvature) * speed / _GRAIN
        steps = np.stack([np.cos(heading), np.sin(heading)], axis=1) * speed / _GRAIN
        return (np.cumsum(steps, axis=0) - steps[0])[::_GRAIN]

    return at


COURSES = {"circle": circle, "path": path}


def learn_displacements(
    camera: SimulatedCamera, progress: Callable[[float], None] | None = None, reach: float = REACH, count: int = COUNT
) -> Workspace:
    """How the middle of the part looks where it lies off by x and y, px of the frame: `count` x `count` pictures."""
    axis = np.linspace(-reach, reach, count)
    scale, total = camera.settings.scale, count * count

    def pictures() -> Iterator[LabelledPicture]:
        for number in range(total):
            x, y = float(axis[number // count]), float(axis[number % count])
            frame = _look(camera, x, y, _PAST + number)
            yield LabelledPicture("part", (x * scale, y * scale), frame.pixels)
            if progress:
                progress((number + 1) / total)

    return learn_workspace(pictures(), (Parameter("x_px"), Parameter("y_px")))


def _look(camera: SimulatedCamera, x: float, y: float, sequence: int, covered: bool = False) -> Frame:
    """A part that lies off to one side is seen as by a camera that is off to the other."""
    return camera.look(Pose(WIDTH / 2 - x, HEIGHT / 2 - y), sequence, covered=covered)


@dataclass(frozen=True, eq=False)
class Followed:
    """One frame of the loop."""

    frame: Frame
    tracked: Tracked
    off: tuple[float, float]
    """How far the part is from the middle of the picture, in truth, in reaches."""

    @property
    def error(self) -> float:
        """The larger of both."""
        return max(abs(self.off[0]), abs(self.off[1]))


def follow(
    camera: SimulatedCamera,
    workspace: Workspace,
    course: Course,
    frames: int,
    *,
    latency: int = 1,
    covered: range = range(0),
) -> Iterator[Followed]:
    """Follows the part for so many frames; it is in the middle of the first picture, and moves from then on.

    What a picture says is known `latency` frames after its exposure, and the hand needs one more to go where it is
    sent: each command says where the part will be by then. In the `covered` frames something stands before the lens.
    """
    reach = np.array(workspace.reach("part"))
    scale = camera.settings.scale
    places = course(frames) * reach
    tracking, hand = begin(workspace), np.zeros(2)
    late = latency + 1
    commands: list[tuple[float, ...] | None] = [None] * late
    for number, place in enumerate(places):
        command = commands[number]
        hand = hand if command is None else np.array(command)
        off = place - hand
        x, y = (off / scale).tolist()
        frame = _look(camera, x, y, number, number in covered)
        tracking, tracked = step(tracking, frame.pixels, frame.t_ns, tuple(hand.tolist()))
        commands.append(aim(tracking, frame.t_ns + round(late * 1e9 / camera.settings.fps)))
        x, y = (off / reach).tolist()
        yield Followed(frame, tracked, (x, y))
