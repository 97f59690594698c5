"""What the service saves of an inspection is read as it was written; messages weigh little."""

from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from inspector.service.checkpoints import Kept, chunk_bytes, read_chunks, read_state, state_bytes
from tests.models.parts import MANY

LINES = st.lists(st.binary(min_size=1, max_size=30).filter(lambda line: b"\n" not in line), max_size=5)
CHUNK = st.lists(st.tuples(st.binary(max_size=30), LINES), max_size=4)


@given(chunks=st.lists(CHUNK, max_size=4))
@MANY
def test_chunks_are_read_as_they_were_added(chunks: list[list[tuple[bytes, list[bytes]]]]):
    frames, messages = read_chunks(chunk_bytes(chunk) for chunk in chunks)
    assert frames == [part for chunk in chunks for part, _ in chunk]
    assert messages == [line for chunk in chunks for _, lines in chunk for line in lines]


@given(
    first=st.none() | st.integers(0, 99),
    starts=st.lists(st.tuples(st.integers(1, 9), st.integers(0, 99)), max_size=3),
    keys=st.dictionaries(st.text(max_size=9), st.integers(0, 99), max_size=3),
    scorer=st.binary(max_size=30),
)
@MANY
def test_a_state_is_read_as_it_was_written(
    first: int | None, starts: list[tuple[int, int]], keys: dict[str, int], scorer: bytes
):
    kept = Kept(first, 7, tuple(starts), keys)
    assert read_state(state_bytes(kept, scorer)) == (kept, scorer)


def test_what_was_said_of_a_second_weighs_less_than_a_third_of_it():
    said = [
        {"kind": "scored", "sequence": i, "t_ns": 10**18 + 33_000_000 * i, "s": i / 270, "score": (i * 37 % 101) / 101}
        for i in range(30)
    ]
    lines = [json.dumps(each).encode() for each in said]
    assert len(chunk_bytes([(b"", lines)])) < sum(map(len, lines)) / 3
