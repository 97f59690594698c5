"""Parts of a recording, joined, are what one process would have recorded."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inspector.errors import NotARecording, OutputExists
from inspector.recording import SweepReader, SweepWriter, join_parts
from models.frame import Frame
from tests.inspector.line import cut
from tests.inspector.recordings import START_NS, encoded_frame, frame
from tests.inspector.test_recording import chunk_compressions, decoded
from tests.models.parts import FEW

FACTS = {"product_id": "plate", "part_id": "7", "inspection_id": "one"}


@dataclass(frozen=True)
class Happened:
    """To one number of a sweep: a frame, or that it was lost."""

    number: int
    lost: bool
    position: float | None

    def record(self, writer: SweepWriter) -> None:
        if self.lost:
            writer.drop(1, START_NS + self.number * 40_000_000)
        else:
            writer.write(encoded_frame(self.number, encoder=self.position))


def written(path: Path, happened: list[Happened]) -> Path:
    with SweepWriter(path, metadata=FACTS) as writer:
        for each in happened:
            each.record(writer)
    return path


def frames_of(path: Path) -> list[Frame]:
    reader = SweepReader(path)
    frames = [*reader]
    assert reader.losses == ()
    return frames


def messages(path: Path) -> dict[str, list[tuple[int, int, bytes]]]:
    """As others read them, checksums validated."""
    return {topic: [(m.sequence, m.log_time, m.data) for m, _ in found] for topic, found in decoded(path).items()}


SWEEPS = st.lists(
    st.tuples(st.integers(0, 5).map(lambda chance: not chance), st.none() | st.floats(-9, 9)), min_size=1, max_size=25
)


@given(
    sweep=SWEEPS,
    at=st.lists(st.integers(0, 25), max_size=4),
    beyond=st.lists(st.integers(0, 6), min_size=5, max_size=5),
)
@FEW
def test_parts_are_joined_to_what_one_process_would_have_recorded(
    sweep: list[tuple[bool, float | None]], at: list[int], beyond: list[int], tmp_path_factory: pytest.TempPathFactory
):
    folder = tmp_path_factory.mktemp("parts")
    happened = [Happened(number, lost, position) for number, (lost, position) in enumerate(sweep)]
    happened.append(Happened(len(sweep), False, 1.0))
    starts = [0, *sorted(min(each, len(sweep)) for each in at)]
    parts = list[Path]()
    for k, ((start, end), more) in enumerate(zip(pairwise([*starts, len(happened)]), beyond, strict=False)):
        # a process that died had gone on for some frames that another one began again with
        ends = end + more if end < len(happened) else end
        parts.append(written(folder / f"{k}.mcap", happened[start:ends]))
    whole = written(folder / "whole.mcap", happened)
    out = folder / "joined.mcap"
    assert join_parts(parts, starts, out) == len(frames_of(whole)) == len(frames_of(out))
    pictures, wanted = (
        [(each.sequence, each.encoder, each.encoded) for each in frames_of(path)] for path in (out, whole)
    )
    assert pictures == wanted
    assert SweepReader(out).facts == FACTS
    assert messages(out) == messages(whole)


def test_a_part_that_a_kill_has_cut_gives_what_was_on_the_disk(tmp_path):
    with SweepWriter(tmp_path / "0.mcap", metadata=FACTS) as writer:
        for number in range(10):
            writer.write(encoded_frame(number))
        writer.flush()
        sure = writer.bytes
        for number in range(10, 20):
            writer.write(encoded_frame(number))
        writer.flush()
        size = writer.bytes
    killed = cut(tmp_path / "0.mcap", tmp_path / "killed.mcap", (sure + 100) / (tmp_path / "0.mcap").stat().st_size)
    assert size > sure + 100
    rest = written(tmp_path / "1.mcap", [Happened(number, False, None) for number in range(10, 25)])
    assert join_parts([killed, rest], [0, 10], tmp_path / "out.mcap") == 25
    assert [each.sequence for each in frames_of(tmp_path / "out.mcap")] == [*range(25)]


def test_a_part_without_a_frame_adds_none(tmp_path):
    empty = written(tmp_path / "0.mcap", [])
    full = written(tmp_path / "1.mcap", [Happened(0, False, None)])
    assert join_parts([empty, full, empty], [0, 0, 1], tmp_path / "out.mcap") == 1
    assert len(frames_of(tmp_path / "out.mcap")) == 1
    assert join_parts([empty, empty], [0, 0], tmp_path / "none.mcap") == 0
    assert SweepReader(tmp_path / "none.mcap").facts == FACTS


def test_pictures_that_were_not_encoded_are_joined_and_compressed(tmp_path):
    for k in (0, 1):
        with SweepWriter(tmp_path / f"{k}.mcap") as writer:
            for number in range(3):
                writer.write(frame(3 * k + number))
    assert join_parts([tmp_path / "0.mcap", tmp_path / "1.mcap"], [0, 3], tmp_path / "out.mcap") == 6
    for number, each in enumerate(frames_of(tmp_path / "out.mcap")):
        assert np.array_equal(each.pixels, frame(number).pixels)
    assert chunk_compressions(tmp_path / "out.mcap") == {"zstd"}


def test_what_cannot_be_joined_is_named_and_leaves_nothing(tmp_path):
    part = written(tmp_path / "0.mcap", [Happened(0, False, None)])
    (tmp_path / "1.mcap").write_bytes(b"no recording")
    out = tmp_path / "out.mcap"
    with pytest.raises(NotARecording, match=r"1\.mcap"):
        join_parts([part, tmp_path / "1.mcap"], [0, 1], out)
    with pytest.raises(ValueError, match="zip"):
        join_parts([part], [0, 1], out)
    assert not out.exists()
    out.write_bytes(b"something else")
    with pytest.raises(OutputExists):
        join_parts([part], [0], out)
    assert out.read_bytes() == b"something else"
