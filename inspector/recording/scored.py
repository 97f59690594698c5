"""ScoredWriter: a sweep together with what the inspection said of it, as Foxglove and rerun show it."""

from types import TracebackType
from typing import Self

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.TextAnnotation_pb2 import TextAnnotation
from google.protobuf.message import Message

from inspector.recording.schemas import new_message, stamp
from inspector.recording.writer import SweepWriter
from models.frame import Frame
from models.verdict import Region, ScoredFrame

SCORE, ANNOTATIONS = "/inspection/score", "/camera/annotations"
NG, OK = Color(r=1.0, g=0.2, b=0.1, a=1.0), Color(r=0.2, g=0.8, b=0.3, a=1.0)
FONT_SIZE = 14.0


class ScoredWriter:
    """Beside each frame its score on `/inspection/score` and its regions as boxes on `/camera/annotations`."""

    def __init__(self, writer: SweepWriter) -> None:
        self.sweep = writer

    def write(self, frame: Frame, scored: ScoredFrame) -> None:
        """Append a frame and what was said of it."""
        self.sweep.write(frame, {SCORE: score_message(scored), ANNOTATIONS: boxes_message(scored)})

    def drop(self, count: int, t_ns: int) -> None:
        """Tell that so many frames were lost before this time."""
        self.sweep.drop(count, t_ns)

    def close(self) -> None:
        """Write the index and close."""
        self.sweep.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def score_message(scored: ScoredFrame) -> Message:
    """The numbers, to plot; `s` is missing where the place is not known."""
    names = ("x", "y", "width", "height", "score", "polarity")
    return new_message(
        "Score",
        scored.t_ns,
        index=scored.index,
        state=str(scored.state),
        s=scored.s,
        score=scored.score,
        raw_score=scored.raw_score,
        appearance=scored.residuals.appearance,
        position=scored.residuals.position,
        timing=scored.residuals.timing,
        reference=scored.reference,
        regions=[{name: getattr(region, name) for name in names} for region in scored.regions],
    )


def boxes_message(scored: ScoredFrame) -> ImageAnnotations:
    """A line of text for the frame, a box with its score for each region."""
    place = scored.state.value if scored.s is None else f"s {scored.s:.3f}"
    title = _text(0, FONT_SIZE, f"{place}  score {scored.score:.2f}", scored.score >= 1.0)
    boxes = ImageAnnotations(
        points=[_box(region) for region in scored.regions],
        texts=[title, *(_text(r.x, r.y, f"{r.score:.2f} {r.polarity}", r.score >= 1.0) for r in scored.regions)],
    )
    for part in (boxes, *boxes.points, *boxes.texts):
        stamp(part.timestamp, scored.t_ns)
    return boxes


def _box(region: Region) -> PointsAnnotation:
    left, top, right, bottom = region.x, region.y, region.x + region.width, region.y + region.height
    corners = ((left, top), (right, top), (right, bottom), (left, bottom))
    return PointsAnnotation(
        type=PointsAnnotation.LINE_LOOP,
        points=[Point2(x=x, y=y) for x, y in corners],
        outline_color=NG if region.score >= 1.0 else OK,
        thickness=2.0,
    )


def _text(x: float, y: float, text: str, alarm: bool) -> TextAnnotation:
    return TextAnnotation(position=Point2(x=x, y=y), text=text, font_size=FONT_SIZE, text_color=NG if alarm else OK)
