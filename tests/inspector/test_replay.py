"""A replay is a function of recording, appearance and policy; what is recorded live is exactly what was scored."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from inspector.cameras import open_camera
from inspector.files import NotWritten
from inspector.live import inspect_live
from inspector.recording import SweepReader, SweepWriter
from inspector.replay import replay
from models.errors import PictureError
from models.frame import Frame
from models.verdict import Judgement, Policy, ScoredFrame
from tests.inspector.conftest import Line
from tests.inspector.line import SPOT, cut, url
from tests.inspector.recordings import encoded_frame


def test_a_good_part_is_ok_and_a_spot_is_found_where_it_is(line: Line) -> None:
    good, spot = (replay(SweepReader(path), line.appearance) for path in (line.good, line.spot))
    assert good.result.verdict is Judgement.OK
    assert good.facts["part_id"] == "0003"
    assert (good.losses, spot.losses) == ((), ())
    assert spot.result.verdict is Judgement.NG
    assert any(d.s_start < 0.5 < d.s_end for d in spot.result.deviations)


def test_the_same_gives_the_same_digest_and_another_policy_another(line: Line) -> None:
    strict = Policy(sensitivity=2.0)
    policies = (Policy(), Policy(), strict, strict)
    once, again, stricter, once_more = (
        replay(SweepReader(line.good), line.appearance, policy).result for policy in policies
    )
    assert once == again
    assert stricter.digest == once_more.digest != once.digest


def test_every_frame_is_told_with_its_score(line: Line) -> None:
    told: list[tuple[Frame, ScoredFrame]] = []
    done = replay(SweepReader(line.good), line.appearance, on_scored=lambda frame, scored: told.append((frame, scored)))
    assert [scored for _, scored in told] == list(done.result.frames)
    assert [frame.t_ns for frame, _ in told] == [frame.t_ns for frame in SweepReader(line.good)]


@pytest.mark.parametrize(
    "options", [SPOT, f"{SPOT}&jpeg=0", "unit=5&lost=0.2&late=3&encoder=1", "unit=6&pause=5&reverse=2&stop=0.7"]
)
def test_live_and_the_replay_of_its_own_recording_agree(line: Line, tmp_path: Path, options: str) -> None:
    with open_camera(url(options)) as camera:
        live = inspect_live(camera, line.appearance, record_to=tmp_path / "a.mcap", part_id="9")
        alone = inspect_live(camera, line.appearance)
    again = replay(SweepReader(tmp_path / "a.mcap"), line.appearance)
    assert live.frames
    assert live == again.result == alone
    assert again.facts["part_id"] == "9"


def test_a_scored_recording_holds_the_same_frames_and_a_score_for_each(line: Line, tmp_path: Path) -> None:
    result = replay(SweepReader(line.spot), line.appearance, scored_recording=tmp_path / "a.mcap").result
    before, after = SweepReader(line.spot), SweepReader(tmp_path / "a.mcap")
    for one, other in zip(before, after, strict=True):
        assert (one.t_ns, one.sequence, one.encoded) == (other.t_ns, other.sequence, other.encoded)
        assert np.array_equal(one.pixels, other.pixels)
    assert after.facts == before.facts
    with (tmp_path / "a.mcap").open("rb") as file:
        topics = Counter(channel.topic for _, channel, _ in make_reader(file).iter_messages())
    assert topics["/inspection/score"] == topics["/camera/annotations"] == len(result.frames)
    assert replay(after, line.appearance).result == result


def test_drops_told_by_the_recorder_stay_in_the_scored_recording(line: Line, tmp_path: Path) -> None:
    with SweepWriter(tmp_path / "a.mcap") as writer:
        for frame in SweepReader(line.good):
            writer.write(frame)
        writer.drop(7, frame.t_ns)
    replay(SweepReader(tmp_path / "a.mcap"), line.appearance, scored_recording=tmp_path / "b.mcap")
    scored = SweepReader(tmp_path / "b.mcap")
    assert len(list(scored)) > 0
    assert [drop.count for drop in scored.drops] == [7]


def test_a_replay_that_fails_leaves_no_scored_recording(line: Line, tmp_path: Path) -> None:
    with SweepWriter(tmp_path / "a.mcap") as writer:
        writer.write(next(iter(SweepReader(line.good))))
        writer.write(encoded_frame(90))
    with pytest.raises(PictureError, match=r"^\S*a\.mcap: .*16x12"):
        replay(SweepReader(tmp_path / "a.mcap"), line.appearance, scored_recording=tmp_path / "b.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_a_scored_recording_without_a_folder_is_refused(line: Line, tmp_path: Path) -> None:
    with pytest.raises(NotWritten, match="there is no folder"):
        replay(SweepReader(line.good), line.appearance, scored_recording=tmp_path / "no" / "a.mcap")


def test_what_a_cut_recording_lost_is_told_and_it_is_never_ok(line: Line, tmp_path: Path) -> None:
    done = replay(SweepReader(cut(line.good, tmp_path / "cut.mcap", 0.5)), line.appearance)
    assert done.losses
    assert done.result.verdict is Judgement.INCOMPLETE
