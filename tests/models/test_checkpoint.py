"""Checkpoint: wherever a sweep is broken off and gone on with from bytes, it says the same to the last bit."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import lru_cache

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.appearance import Appearance
from models.checkpoint import SEAL, from_bytes, to_bytes
from models.errors import CheckpointError
from models.frame import Frame
from models.inspection import Inspection, begin, conclude, digest, step
from models.learning import learn
from models.verdict import FrameState, Policy
from tests.models.parts import FEW, SIZE, View, frame, golden, places, surface, swept, with_spot
from tests.models.test_encoder import knowing, with_encoder
from tests.models.test_turning import VIEWS, table, turned

SEEN = View(seed=41)
COLOUR, DEEP = View(seed=42, colour=True), View(seed=43, deep=True)
FLAT = np.full(SIZE[::-1], 90, np.uint8)


@lru_cache
def several_scales() -> Appearance:
    return learn([swept(surface(), view=View(dx=0.3 * seed, seed=seed)) for seed in range(5)])


@lru_cache
def ignoring() -> Appearance:
    mask = np.zeros(SIZE[::-1], bool)
    mask[20:50, 60:100] = True
    return learn([swept(surface())], ignore=mask)


@lru_cache
def of_kind(view: View) -> Appearance:
    return learn([swept(surface(), view=view)])


@lru_cache
def long() -> Appearance:
    """Of so many places that only some are looked at."""
    return learn([swept(surface(1, 780), places(last=149))])


def numbered(pictures: Sequence[np.ndarray]) -> list[Frame]:
    return [frame(pixels, i) for i, pixels in enumerate(pictures)]


def with_pictures(at: dict[int, np.ndarray]) -> list[Frame]:
    """A good sweep with other pictures at some frames."""
    return [frame(at.get(each.sequence, each.pixels), each.sequence) for each in swept(surface(), view=SEEN)]


def upside_down() -> list[Frame]:
    return numbered([cv2.rotate(each.pixels, cv2.ROTATE_180) for each in reversed(swept(surface(), view=SEEN))])


def waits_for_the_part() -> list[Frame]:
    empty = swept(surface(7), [10.0] * 12, View(seed=5))
    moved = swept(surface(8), [20.0] * 4, View(seed=6))
    return numbered([each.pixels for each in [*empty, *moved, *swept(surface(), view=SEEN)]])


def noise(count: int) -> list[np.ndarray]:
    return [np.random.default_rng(i).integers(0, 255, SIZE[::-1], np.uint8) for i in range(count)]


def jumps() -> list[Frame]:
    ats = np.concatenate([places(last=20), places(first=45), places(first=5, last=15)])
    return swept(surface(), ats, SEEN)


def another_part_first() -> list[Frame]:
    return numbered([each.pixels for each in [*swept(surface(2))[:15], *swept(surface(), view=SEEN)]])


LIES = 7 + 0.5 * places()[::-1]
STRANGE = with_spot(with_spot(surface(), 230, 110, 60), 280, 90, 50, -80)
SWEEPS: dict[str, tuple[Callable[[], Appearance], Callable[[], list[Frame]]]] = {
    "good": (golden, lambda: swept(surface(), view=SEEN)),
    "a defect": (golden, lambda: swept(with_spot(surface(), 230, 110), view=SEEN)),
    "much wrong about it": (golden, lambda: swept(STRANGE, view=SEEN)),
    "off, turned, and in another light": (
        golden,
        lambda: swept(surface(), view=View(dx=4, dy=-3, turn=0.01, gain=0.8, shade=0.1, seed=3)),
    ),
    "a standstill, another pace": (
        golden,
        lambda: swept(surface(), np.concatenate([places(0.6, last=20), np.full(9, 20.0), places(1.7, first=21)]), SEEN),
    ),
    "blind for a while": (golden, lambda: with_pictures(dict.fromkeys(range(20, 26), FLAT))),
    "blind from the first frame": (golden, lambda: with_pictures(dict.fromkeys(range(7), FLAT))),
    "lost for a while": (golden, lambda: with_pictures(dict(enumerate(noise(14), 22)))),
    "jumps": (golden, jumps),
    "frames that never came": (golden, lambda: [each for each in swept(surface(), view=SEEN) if each.sequence % 5]),
    "another part": (golden, lambda: swept(surface(2), view=SEEN)),
    "another part first": (golden, another_part_first),
    "upside down": (golden, upside_down),
    "waits for the part": (golden, waits_for_the_part),
    "several scales": (several_scales, lambda: swept(with_spot(surface(), 230, 110, 24, 18), view=SEEN)),
    "pixels that say nothing": (ignoring, lambda: swept(with_spot(surface(), 230, 110), view=SEEN)),
    "encoder": (knowing, lambda: with_encoder(swept(surface(), view=SEEN), 30 + 0.5 * places())),
    "an encoder that lies": (knowing, lambda: with_encoder(with_pictures(dict(enumerate(noise(5), 30))), LIES)),
    "long": (long, lambda: swept(surface(1, 780), places(2.3, last=149), SEEN)),
    "colour": (lambda: of_kind(COLOUR), lambda: swept(with_spot(surface(), 230, 110), view=COLOUR)),
    "sixteen bits": (lambda: of_kind(DEEP), lambda: swept(surface(2), view=DEEP)),
    "turning": (table, lambda: numbered([turned(at) for at in np.arange(0, VIEWS - 1, 0.7)])),
    "another body that turns": (table, lambda: numbered([turned(at, seed=3) for at in range(VIEWS)])),
}


def resumed(state: Inspection, appearance: Appearance | None = None) -> Inspection:
    return from_bytes(appearance or state.appearance, to_bytes(state), state.frames, state.beginning.kept)


@lru_cache
def whole(name: str) -> tuple[list[Frame], list[Inspection]]:
    """The frames of a sweep, and the state before each of them and after the last."""
    appearance, frames = SWEEPS[name][0](), SWEEPS[name][1]()
    states = [begin(appearance)]
    for each in frames:
        states.append(step(states[-1], each)[0])
    return frames, states


@pytest.mark.parametrize("name", SWEEPS)
def test_broken_off_at_every_frame_it_says_the_same_to_the_last_bit(name: str):
    frames, states = whole(name)
    state = states[0]
    for each, wanted in zip(frames, states[1:], strict=True):
        state, scored = step(resumed(state), each)
        # text tells every bit of a number, and the one zero from the other
        assert repr(scored) == repr(wanted.frames[-1])
        assert to_bytes(state) == to_bytes(wanted)
    assert conclude(resumed(state)) == conclude(states[-1])


@given(name=st.sampled_from(tuple(SWEEPS)), at=st.floats(0, 1))
@FEW
def test_broken_off_anywhere_it_ends_with_the_same_result(name: str, at: float):
    frames, states = whole(name)
    state = resumed(states[round(at * len(frames))])
    for each in frames[state.count :]:
        state, _ = step(state, each)
    assert digest(state) == digest(states[-1])
    assert conclude(state) == conclude(states[-1])


def test_the_policy_goes_with_it():
    policy = Policy(sensitivity=1.3, false_rejects=0.1)
    frames, state = whole("a defect")[0], begin(golden(), policy)
    for each in frames[:30]:
        state, _ = step(state, each)
    assert resumed(state).policy == policy
    assert step(resumed(state), frames[30])[1] == step(state, frames[30])[1] != whole("a defect")[1][31].frames[-1]


def test_the_sweeps_of_these_tests_come_to_all_that_is_carried():
    states = [state for name in SWEEPS for state in whole(name)[1]]
    assert {scored.state for state in states for scored in state.frames} == {*FrameState}
    trails = [state.memory.trail for state in states]
    assert max(trail.misses for trail in trails) > 8
    assert max(trail.rivalry for trail in trails) > 0
    assert max(trail.places.unseen for trail in trails) > 0
    assert any(trail.fixture is None and state.count > 20 for trail, state in zip(trails, states, strict=True))
    assert any(trail.strange is not None for trail in trails)
    assert {None if trail.reading is None else trail.reading.honest for trail in trails} == {None, True, False}
    beginnings = [state.beginning for state in states]
    assert max(len(beginning.kept) for beginning in beginnings) >= 5
    assert any(beginning.last is not None for beginning in beginnings)
    assert any(beginning.confirmed and beginning.doubted for beginning in beginnings)
    sights = [sight for state in states for sight in state.memory.sights]
    assert {sight.score.shape[2] for sight in sights} == {2, 4}
    assert any(np.isinf(sight.score).any() and sight.unseen is not None for sight in sights)


def test_an_appearance_that_was_loaded_again_will_do():
    frames, states = whole("a defect")
    again = Appearance.from_bytes(golden().to_bytes())
    state = resumed(states[30], again)
    for each in frames[30:]:
        state, _ = step(state, each)
    assert conclude(state) == conclude(states[-1])


def test_a_sweep_of_many_frames_is_gone_on_with_too():
    frames = swept(surface(), np.concatenate([np.full(300, 0.0), places()]), SEEN)
    state = begin(golden())
    for each in frames[:300]:
        state, _ = step(state, each)
    again = resumed(state)
    assert (again.count, len(again.earlier), len(again.latest)) == (300, 1, 44)
    for each in frames[300:]:
        (state, _), (again, _) = step(state, each), step(again, each)
    assert digest(again) == digest(state)


def sealed(payload: bytes, version: int = 1) -> bytes:
    return SEAL.tag + version.to_bytes(4, "little") + hashlib.sha256(payload).digest() + payload


@given(at=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@FEW
def test_a_bit_that_is_not_as_it_was_is_refused(at: float, bit: int):
    state = whole("upside down")[1][20]
    data = bytearray(to_bytes(state))
    data[int(at * len(data))] ^= 1 << bit
    with pytest.raises(CheckpointError):
        from_bytes(golden(), bytes(data), state.frames, state.beginning.kept)


def test_what_is_no_checkpoint_of_this_inspection_is_refused_in_words():
    state = whole("upside down")[1][20]
    data, frames, kept = to_bytes(state), state.frames, state.beginning.kept
    payload = data[len(SEAL.tag) + 4 + 32 :]
    other = whole("good")[1][20]
    wrong: list[tuple[str, Appearance, bytes, Sequence, Sequence]] = [
        ("does not begin as one", golden(), golden().to_bytes(), frames, kept),
        ("does not begin as one", golden(), b"", frames, kept),
        ("format version 2", golden(), sealed(payload, 2), frames, kept),
        ("checksum does not fit", golden(), data[:-1], frames, kept),
        ("cannot be read", golden(), sealed(b"\x00" * 40), frames, kept),
        ("lacks what version 1 holds", golden(), sealed(payload.replace(b"chain", b"chaim")), frames, kept),
        ("is of appearance", table(), data, frames, kept),
        ("20 scored frames given are not", golden(), data, other.frames, kept),
        ("19 scored frames given are not the 20", golden(), data, frames[:-1], kept),
        ("are of frames []", golden(), data, frames, ()),
        ("places has shape (60, 3)", golden(), sealed(payload.replace(b"[3,60]", b"[60,3]")), frames, kept),
    ]
    for words, appearance, given_bytes, scored, pictures in wrong:
        with pytest.raises(CheckpointError) as told:
            from_bytes(appearance, given_bytes, scored, pictures)
        assert words in str(told.value)
