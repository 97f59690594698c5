"""Appearance: the same bytes out as in, and a sentence for every file that cannot be trusted."""

import hashlib
import json
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from safetensors.numpy import load, save

from models.appearance import SEAL, VERSION, Appearance
from models.errors import AppearanceError
from models.learning import learn
from tests.models.parts import FIRST, MANY, STEP, View, frame, golden, inspected, places, shot, surface, swept

MAGIC = SEAL.tag
HEAD = len(MAGIC) + 4
PAYLOAD = HEAD + 32


@lru_cache
def small() -> Appearance:
    return learn([swept(surface(), places(last=11))])


@lru_cache
def kept() -> bytes:
    return small().to_bytes()


def sealed(payload: bytes) -> bytes:
    """A file whose checksum fits, whatever is in it."""
    return MAGIC + VERSION.to_bytes(4, "little") + hashlib.sha256(payload).digest() + payload


def forged(
    arrays: Callable[[dict[str, np.ndarray]], object] = lambda _: None,
    header: Callable[[dict[str, Any]], object] = lambda _: None,
) -> bytes:
    """The file with its arrays or its header changed, and a checksum that fits again."""
    payload = kept()[PAYLOAD:]
    held, size = load(payload), int.from_bytes(payload[:8], "little")
    told = json.loads(json.loads(payload[8 : 8 + size])["__metadata__"]["appearance"])
    arrays(held)
    header(told)
    return sealed(save(held, {"appearance": json.dumps(told)}))


def used(data: bytes) -> None:
    """Load it and inspect with it."""
    inspected(Appearance.from_bytes(data), swept(surface(), places(last=3)))


@pytest.mark.parametrize("made", [golden, small], ids=["two sweeps", "one sweep"])
def test_what_was_saved_comes_back_with_the_same_bytes_and_the_same_name(made: Callable[[], Appearance]):
    before = made()
    data = before.to_bytes()
    after = Appearance.from_bytes(data)
    assert after.to_bytes() == data == before.to_bytes()
    assert after.id == before.id == "sha256:" + hashlib.sha256(data).hexdigest()
    assert (after.places, after.size, after.interval_ns) == (before.places, before.size, before.interval_ns)


@pytest.mark.parametrize("view", [View(colour=True), View(deep=True)], ids=["colour", "sixteen bits"])
def test_every_kind_of_picture_comes_back(view: View):
    data = learn([swept(surface(), places(last=5), view)]).to_bytes()
    assert Appearance.from_bytes(data).to_bytes() == data


@pytest.mark.parametrize("size", [(640, 480), (1280, 960), (1280, 720), (1920, 1080)])
def test_pictures_of_every_size_come_back(size: tuple[int, int]):
    pictures = (cv2.resize(shot(surface(), FIRST + STEP * at), size) for at in range(3))
    data = learn([[frame(picture, i) for i, picture in enumerate(pictures)]]).to_bytes()
    assert Appearance.from_bytes(data).to_bytes() == data


def test_what_came_back_scores_like_what_was_saved():
    frames = swept(surface(), places(last=20), View(seed=3))
    again = Appearance.from_bytes(golden().to_bytes())
    assert inspected(golden(), frames) == inspected(again, frames)


def test_other_sweeps_have_other_names():
    other = learn([swept(surface(), places(last=11), View(seed=1))])
    assert other.id != small().id


def flips() -> list[int]:
    """Positions in every part of the file: all of the head and the hash, and a sample of what follows."""
    rng = np.random.default_rng(1)
    size = len(kept())
    return [*range(PAYLOAD), *range(PAYLOAD, PAYLOAD + 16), *rng.integers(PAYLOAD, size, 80), size - 1]


def accepted(positions: list[int]) -> list[tuple[int, int]]:
    """Position and bit of each flip that was not refused with an AppearanceError."""
    found = list[tuple[int, int]]()
    for position in positions:
        for bit in range(8):
            data = bytearray(kept())
            data[position] ^= 1 << bit
            try:
                Appearance.from_bytes(bytes(data))
            except AppearanceError:
                continue
            found.append((position, bit))
    return found


def test_a_single_flipped_bit_is_refused():
    assert accepted(flips()) == []


@given(share=st.floats(0, 1, exclude_max=True))
@MANY
def test_a_file_cut_anywhere_is_refused(share: float):
    with pytest.raises(AppearanceError):
        Appearance.from_bytes(kept()[: int(share * len(kept()))])


@pytest.mark.parametrize("length", [*range(0, PAYLOAD + 20, 3), HEAD, PAYLOAD, -1])
def test_a_file_cut_in_its_head_is_refused(length: int):
    with pytest.raises(AppearanceError):
        Appearance.from_bytes(kept()[:length])


def test_a_file_with_something_behind_its_end_is_refused():
    with pytest.raises(AppearanceError):
        Appearance.from_bytes(kept() + b"\0")


@given(newer=st.integers(VERSION + 1, 2**32 - 1))
@MANY
def test_a_newer_version_is_refused_by_both_versions(newer: int):
    data = MAGIC + newer.to_bytes(4, "little") + kept()[HEAD:]
    with pytest.raises(AppearanceError) as refused:
        Appearance.from_bytes(data)
    assert str(newer) in str(refused.value)
    assert str(VERSION) in str(refused.value).replace(str(newer), "")


@given(data=st.binary(max_size=300), head=st.sampled_from((b"", MAGIC, MAGIC + VERSION.to_bytes(4, "little"))))
@MANY
def test_random_bytes_are_refused(data: bytes, head: bytes):
    with pytest.raises(AppearanceError):
        Appearance.from_bytes(head + data)


@given(data=st.binary(max_size=300))
@MANY
def test_random_bytes_with_a_checksum_that_fits_are_refused(data: bytes):
    with pytest.raises(AppearanceError):
        Appearance.from_bytes(sealed(data))


def test_a_forged_file_that_changes_nothing_is_as_good_as_the_real_one():
    assert Appearance.from_bytes(forged()).to_bytes() == kept()


def test_every_array_is_missed_by_a_sentence():
    for name in load(kept()[PAYLOAD:]):
        with pytest.raises(AppearanceError):
            used(forged(lambda arrays, name=name: arrays.pop(name)))


@pytest.mark.parametrize("name", ["preparation", "manifold", "limits", "peaks", "noise", "interval_ns", "facts"])
def test_every_entry_of_the_header_is_missed_by_a_sentence(name: str):
    with pytest.raises(AppearanceError):
        used(forged(header=lambda header: header.pop(name)))


@pytest.mark.parametrize("name", ["preparation", "manifold", "limits", "noise", "interval_ns"])
@pytest.mark.parametrize("value", [None, "x", [], {"a": 1}])
def test_an_entry_of_the_wrong_type_is_refused(name: str, value: object):
    with pytest.raises(AppearanceError):
        used(forged(header=lambda header: header.update({name: value})))


@pytest.mark.parametrize("name", ["slope", "eigenspace.basis", "keys", "points"])
def test_an_array_of_another_shape_is_refused_by_its_name(name: str):
    with pytest.raises(AppearanceError, match=name.rpartition(".")[2]):
        used(forged(lambda arrays: arrays.update({name: arrays[name][:-1]})))


def test_motion_of_another_number_of_places_is_refused():
    with pytest.raises(AppearanceError, match=r"samples has shape \(12, 11\), allowed is \(11, 11\)"):
        used(forged(lambda arrays: arrays.update(motion=arrays["motion"][:-1])))


@pytest.mark.parametrize("value", [25, 255])
def test_points_outside_of_their_cells_are_refused(value: int):
    with pytest.raises(AppearanceError, match="points"):
        used(forged(lambda arrays: arrays.update(points=np.full_like(arrays["points"], value))))


@pytest.mark.parametrize("keys", [[0, 2, 2], [2, 0, 4], [-1, 2, 4], [0, 2, 12]])
def test_keys_that_are_no_places_in_order_are_refused(keys: list[int]):
    def spoil(arrays: dict[str, np.ndarray]) -> None:
        arrays["keys"] = np.array([*keys, *arrays["keys"][3:]], np.int32)

    with pytest.raises(AppearanceError, match="keys"):
        Appearance.from_bytes(forged(spoil))


@pytest.mark.parametrize("name", ["slope", "motion", "manifold.samples", "eigenspace.mean", "eigenspace.basis"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_value_that_is_no_number_is_refused_by_the_name_of_its_array(name: str, value: float):
    def spoil(arrays: dict[str, np.ndarray]) -> None:
        arrays[name] = arrays[name].copy()
        arrays[name].flat[3] = value

    with pytest.raises(AppearanceError, match=name.rpartition(".")[2]):
        Appearance.from_bytes(forged(spoil))


@pytest.mark.parametrize(
    ("name", "kind"), [("slope", np.int32), ("motion", np.bool_), ("points", np.float32), ("keys", np.uint64)]
)
def test_an_array_of_another_type_is_refused_by_its_name(name: str, kind: type):
    with pytest.raises(AppearanceError, match=name):
        Appearance.from_bytes(forged(lambda arrays: arrays.update({name: arrays[name].astype(kind)})))


def test_motion_beyond_the_picture_is_refused():
    with pytest.raises(AppearanceError, match="motion leaves its 160x120 templates"):
        Appearance.from_bytes(forged(lambda arrays: arrays.update(motion=arrays["motion"] * 50)))


NO_NUMBERS = ("six", [], {"a": 1}, np.nan, np.inf, -1.0, 10**400)


@pytest.mark.parametrize("name", ["floor", "share", "weight"])
@pytest.mark.parametrize("value", NO_NUMBERS)
def test_a_limit_that_is_no_number_from_0_up_is_refused(name: str, value: object):
    with pytest.raises(AppearanceError):
        Appearance.from_bytes(forged(header=lambda header: header["limits"][0].update({name: value})))


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_a_peak_that_is_no_number_from_0_up_is_refused(value: object):
    with pytest.raises(AppearanceError):
        Appearance.from_bytes(forged(header=lambda header: header.update(peaks=[0.5, value])))


@pytest.mark.parametrize("count", [0, 3])
def test_limits_of_no_scale_or_of_more_than_two_are_refused(count: int):
    with pytest.raises(AppearanceError, match=f"limits of {count} scales, allowed are one or two"):
        Appearance.from_bytes(forged(header=lambda header: header.update(limits=count * header["limits"])))


@pytest.mark.parametrize("name", ["floor", "weight"])
def test_a_limit_that_tolerates_nothing_is_refused(name: str):
    with pytest.raises(AppearanceError, match="tolerates nothing"):
        Appearance.from_bytes(forged(header=lambda header: header["limits"][0].update({name: 0})))


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0, 1e308])
def test_noise_that_is_none_or_no_number_is_refused(value: float):
    with pytest.raises(AppearanceError, match="noise"):
        Appearance.from_bytes(forged(header=lambda header: header.update(noise=value)))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_interval_that_is_no_number_is_refused(value: float):
    with pytest.raises(AppearanceError):
        Appearance.from_bytes(forged(header=lambda header: header.update(interval_ns=value)))


@pytest.mark.parametrize("value", [None, 5, [], {"sweeps": 2}])
def test_facts_that_are_not_text_are_refused(value: object):
    with pytest.raises(AppearanceError):
        Appearance.from_bytes(forged(header=lambda header: header.update(facts=value)))


@pytest.mark.parametrize("picture", [None, [80, 60], [161, 120]])
def test_a_preparation_for_other_pictures_than_those_kept_is_refused(picture: list[int] | None):
    with pytest.raises(AppearanceError):
        Appearance.from_bytes(forged(header=lambda header: header["preparation"].update(picture=picture)))


def test_a_preparation_that_gives_more_values_than_the_eigenspace_takes_is_refused():
    with pytest.raises(AppearanceError, match="mean has shape"):
        Appearance.from_bytes(forged(header=lambda header: header["preparation"].update(colour=True)))


def test_a_header_nested_without_end_is_refused():
    held = load(kept()[PAYLOAD:])
    with pytest.raises(AppearanceError, match="cannot be read"):
        Appearance.from_bytes(sealed(save(held, {"appearance": "[" * 100_000})))


def test_a_reference_picture_that_is_none_is_refused():
    with pytest.raises(AppearanceError, match="picture"):
        used(forged(lambda arrays: arrays.update(pictures=np.zeros_like(arrays["pictures"]))))


def without(name: str) -> bytes:
    """The file with an array that holds nothing."""
    return forged(lambda arrays: arrays.update({name: arrays[name][:0]}))


def test_an_array_that_holds_nothing_is_refused():
    # one golden sweep leaves `tolerance` empty anyway
    for name in sorted(set(load(kept()[PAYLOAD:])) - {"tolerance"}):
        with pytest.raises(AppearanceError):
            used(without(name))


@pytest.mark.parametrize("count", [6, 8])
def test_tolerances_for_another_number_of_pictures_are_refused(count: int):
    with pytest.raises(AppearanceError, match=f"{count} tolerances, allowed is one a picture: 7"):
        used(forged(lambda arrays: arrays.update({"tolerance.ends": np.zeros(count, np.int64)})))
