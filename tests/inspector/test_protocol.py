"""The header of a frame on the stream: what is sent is what is read, and anything else is refused in words."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from inspector.protocol import HEADER, BadFrame, SentFrame


@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**63 - 1),
    st.none() | st.floats(allow_nan=False, allow_infinity=False),
    st.binary(max_size=50),
)
def test_a_frame_comes_out_as_it_went_in(sequence: int, t_ns: int, encoder: float | None, picture: bytes):
    got = SentFrame.from_bytes(SentFrame(sequence, t_ns, encoder, picture).to_bytes())
    assert (got.sequence, got.t_ns, got.encoder, bytes(got.picture)) == (sequence, t_ns, encoder, picture)


def test_what_a_later_version_puts_after_the_header_is_skipped():
    longer = HEADER.pack(1, 0, HEADER.size + 3, 4, 5, 0.0) + b"newpicture"
    assert bytes(SentFrame.from_bytes(longer).picture) == b"picture"


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"short", "a message of 5 bytes"),
        (HEADER.pack(2, 0, 24, 0, 0, 0.0), "version 2"),
        (HEADER.pack(1, 0, 23, 0, 0, 0.0), "header of 23 bytes"),
        (HEADER.pack(1, 0, 25, 0, 0, 0.0), "header of 25 bytes in a message of 24"),
        (HEADER.pack(1, 0, 24, 0, -1, 0.0), "a time of -1"),
        (HEADER.pack(1, 1, 24, 0, 0, float("nan")), "an encoder position of nan"),
    ],
)
def test_anything_else_is_refused_in_words(data: bytes, said: str):
    with pytest.raises(BadFrame, match=said):
        SentFrame.from_bytes(data)
