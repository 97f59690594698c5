"""SweepReader: MCAP -> frames, streaming, in recorded order; says what was lost on the way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

from inspector.errors import ManyCameras, NoPictures, NoSuchTopic, NotARecording, RecordingError
from inspector.locations import Location, RemoteFile, to_location
from inspector.objects import NoSuchObject
from inspector.pictures import MAX_PIXELS
from inspector.recording.decoding import holds_pictures
from inspector.recording.framing import MAGIC
from inspector.recording.reading import Pass
from inspector.recording.summary import Survey, read_facts, survey, survey_summary
from inspector.recording.writer import IMAGE
from models.frame import Frame


@dataclass(frozen=True)
class Drop:
    """Frames that the recorder could not keep."""

    t_ns: int
    count: int


class SweepReader:
    """The frames of one topic of one recording; can be iterated again and again, each time from the file.

    The time of a frame is the log time. A picture that cannot be decoded, or has more than `max_pixels`, is left out
    and told in `losses`, never shown; its number stays free in `sequence`. What is named by URL is fetched as it is
    read.
    """

    def __init__(
        self, path: Path | RemoteFile | str, *, topic: str | None = None, max_pixels: int = MAX_PIXELS
    ) -> None:
        self.path = find_recording(to_location(path))
        self._wanted, self._max_pixels = topic, max_pixels
        self.losses: tuple[str, ...] = ()
        """After a pass: a sentence for each thing that was lost or not readable."""
        self.drops: tuple[Drop, ...] = ()
        """After a pass: what the recorder had to drop."""

    @cached_property
    def facts(self) -> dict[str, str]:
        """What was said of the sweep when it was recorded: `product_id`, `part_id`, ..."""
        with self.path.open("rb") as file:
            return read_facts(file)

    @cached_property
    def topic(self) -> str:
        """The topic that is read: the one asked for, else /camera/image, else the only one with pictures."""
        return choose_topic(self.path, self._survey, self._wanted)

    @cached_property
    def _survey(self) -> Survey:
        with self.path.open("rb") as file:
            return survey(file)

    def __iter__(self) -> Iterator[Frame]:
        with self.path.open("rb") as file:
            run = Pass(self.path, self._survey, self.topic, self._max_pixels)
            try:
                yield from run.frames(file)
            finally:
                self.losses = tuple(run.losses())
                self.drops = tuple(Drop(t_ns, count) for t_ns, count in run.drops)
        if not run.yielded:
            raise NoPictures(self.path, "; ".join(self.losses) or f"topic {self.topic} is empty")


def find_recording(path: Location) -> Location:
    """The recording itself, or the only one in a folder, as rosbag2 writes it; it must begin as an MCAP does."""
    if isinstance(path, Path) and path.is_dir():
        found = sorted(path.glob("*.mcap"))
        if len(found) != 1:
            raise NotARecording(path, f"a folder with {len(found)} MCAP files")
        path = found[0]
    try:
        with path.open("rb") as file:
            begins_as_mcap(path, file.read(len(MAGIC)))
    except OSError as error:
        raise NotARecording(path, error.strerror or str(error)) from error
    except NoSuchObject as error:
        raise NotARecording(path, "there is nothing by that name") from error
    return path


def begins_as_mcap(path: Location, start: bytes) -> bool:
    """True for the first bytes of a recording, 8 or more; raises NotARecording for others."""
    if start[: len(MAGIC)] != MAGIC:
        raise NotARecording(path, _why_not(start[: len(MAGIC)]))
    return True


def _why_not(start: bytes) -> str:
    if not start:
        return "the file is empty"
    if start.startswith(b"\x89MCAP0"):
        return "its line endings were converted on the way, which ruins every byte of it; copy it again as binary"
    return f"no MCAP, it begins with {start.hex()}"


def choose_topic(path: Location, found: Survey, wanted: str | None) -> str:
    """The topic to read; an error lists what there is."""
    counts = Counter[str]()
    for number, channel in found.channels.items():
        if holds_pictures(channel, found.schemas.get(channel.schema_id)):
            counts[channel.topic] += found.counts.get(number, 0)
    topics = sorted(topic for topic, count in counts.items() if count) or sorted(counts)
    if wanted is not None and topics and wanted not in topics:
        raise NoSuchTopic(path, wanted, topics)
    if not topics:
        names = sorted({channel.topic for channel in found.channels.values()})
        why = f"{len(names)} topics, none with pictures" if names else "no topics in it"
        raise NoPictures(path, f"{why}; {found.note}" if found.note else why)
    if wanted is None and IMAGE not in topics and len(topics) > 1:
        raise ManyCameras(path, topics)
    return wanted or (IMAGE if IMAGE in topics else topics[0])


def count_frames(path: Path | RemoteFile | str) -> int | None:
    """The number of frames that the summary announces, without reading them; None when there is no summary."""
    with suppress(RecordingError, ValueError):
        found = find_recording(to_location(path))
        with found.open("rb") as file:
            return _count(found, file)
    return None


def _count(path: Location, file: BinaryIO) -> int | None:
    found = survey_summary(file)
    if found is None:
        return None
    topic = choose_topic(path, found, None)
    return sum(found.counts.get(number, 0) for number, channel in found.channels.items() if channel.topic == topic)
