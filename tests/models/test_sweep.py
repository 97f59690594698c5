"""Sweep: the facts of the order of frames."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from models.frame import Frame
from models.sweep import Gap, Sweep, SweepFacts


@given(lost=st.sets(st.integers(1, 38), max_size=30), interval=st.integers(1, 10**9))
def test_every_lost_frame_is_counted(lost: set[int], interval: int):
    sequences = [i for i in range(40) if i not in lost]
    facts = SweepFacts.of_stamps([i * interval for i in sequences], sequences)
    assert (facts.frames, facts.lost, facts.disorder) == (40 - len(lost), len(lost), ())
    assert facts.duration_ns == 39 * interval
    follow = any(b == a + 1 for a, b in pairwise(sequences))
    assert facts.interval_ns == (interval if follow else 0)


def test_a_pause_does_not_change_the_nominal_interval():
    times = np.cumsum([0, 33, 34, 33, 5000, 33, 33]).tolist()
    assert SweepFacts.of_stamps(times, list(range(7))).interval_ns == 33


def test_time_that_stands_or_goes_back_is_named():
    facts = SweepFacts.of_stamps([0, 10, 10, 5, 20], [0, 1, 2, 3, 3])
    assert facts.disorder == (
        "frame 2 has the time 10 of frame 1",
        "frame 3 is 5 ns older than frame 2",
        "frame 4 has sequence number 3 after 3",
    )


def test_no_frames_have_no_facts():
    assert SweepFacts.of_stamps([], []) == SweepFacts(0, 0, 0, (), ())


def test_a_sweep_is_read_anew_each_time():
    pixels = np.zeros((2, 2), np.uint8)
    opened: list[int] = []

    def read():
        opened.append(1)
        return (Frame(pixels, t_ns=10 * i, sequence=i) for i in (0, 1, 4))

    sweep = Sweep(read)
    assert [frame.sequence for frame in sweep] == [frame.sequence for frame in sweep] == [0, 1, 4]
    assert sweep.facts.gaps == (Gap(index=2, lost=2),)
    assert sweep.facts.lost == 2
    assert len(opened) == 3
