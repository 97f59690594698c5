"""Objects are read by range, written once, and what goes wrong is told without secrets."""

import datetime
import io
import random

import obstore
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inspector import objects
from inspector.locations import RemoteFile, list_locations, open_location, to_location
from inspector.objects import LocationRefused, NoSuchObject, Objects, ObjectsUnusable, ObjectTaken, beneath, shown
from tests.buckets import unconditional


@pytest.fixture
def bucket(buckets) -> Objects:
    return Objects(beneath(buckets.new(), "line 1"))


def put(bucket, tmp_path, name, data):
    path = tmp_path / "draft"
    path.write_bytes(data)
    bucket.put_new(name, path)


def test_what_was_written_is_there_once(bucket, tmp_path):
    put(bucket, tmp_path, "sweeps/ü 1.mcap", b"first")
    with pytest.raises(ObjectTaken, match=r"s3://bucket-\d+/line 1/sweeps/ü 1.mcap exists already"):
        put(bucket, tmp_path, "sweeps/ü 1.mcap", b"second")
    assert bucket.open("sweeps/ü 1.mcap").read() == b"first"
    assert bucket.size("sweeps/ü 1.mcap") == 5
    bucket.remove("sweeps/ü 1.mcap")
    bucket.remove("sweeps/ü 1.mcap")
    assert bucket.size("sweeps/ü 1.mcap") is None
    with pytest.raises(NoSuchObject):
        bucket.open("sweeps/ü 1.mcap")


@pytest.mark.parametrize("refuses", [False, True])
def test_nothing_is_written_over_where_conditions_are_not_known(buckets, refuses, tmp_path):
    with unconditional(refuses=refuses) as service:
        bucket = Objects(service.new())
        put(bucket, tmp_path, "a.mcap", b"first")
        with pytest.raises(ObjectTaken):
            put(bucket, tmp_path, "a.mcap", b"second")
        assert bucket.open("a.mcap").read() == b"first"


def test_a_large_file_goes_in_parts_and_is_not_written_over_either(bucket, tmp_path, monkeypatch):
    monkeypatch.setattr(objects, "_AT_ONCE", 5 << 22)
    data = random.Random(1).randbytes((5 << 22) + 1)
    put(bucket, tmp_path, "large", data)
    size, pieces = bucket.stream("large")
    assert (size, b"".join(pieces)) == (len(data), data)
    with pytest.raises(ObjectTaken):
        put(bucket, tmp_path, "large", data)


def test_names_are_those_beneath(bucket, buckets, tmp_path):
    for name in ("b.mcap", "a.mcap", "deep/c.mcap", "d.txt"):
        put(bucket, tmp_path, name, b"1")
    put(Objects(bucket.url.replace("line 1", "line 10")), tmp_path, "e.mcap", b"1")
    assert [*bucket.names(".mcap")] == [("a.mcap", 1), ("b.mcap", 1), ("deep/c.mcap", 1)]
    found = list_locations(bucket.url, ".mcap")
    assert [each.name for each in found] == ["a.mcap", "b.mcap", "c.mcap"]
    assert [open_location(each).read() for each in found] == [b"1"] * 3


@pytest.fixture(scope="module")
def long(buckets, tmp_path_factory) -> tuple[bytes, str]:
    """Larger than all that is fetched at once."""
    bucket, data = Objects(buckets.new()), random.Random(2).randbytes((9 << 20) + 77)
    put(bucket, tmp_path_factory.mktemp("long"), "long", data)
    return data, beneath(bucket.url, "long")


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(0, (9 << 20) + 200), st.integers(0, 3 << 20)), max_size=6))
def test_an_object_reads_as_a_file_does(long, steps):
    data, url = long
    with open_location(url) as file:
        ours = io.BytesIO(data)
        assert file.seek(0, io.SEEK_END) == ours.seek(0, io.SEEK_END) == len(data)
        for offset, count in steps:
            assert file.seek(offset) == ours.seek(offset)
            assert file.read(count) == ours.read(count)
            assert file.tell() == ours.tell()


def test_little_is_fetched_after_a_jump_and_much_when_reading_on(long, monkeypatch):
    data, url = long
    asked, whole = [], Objects.range

    def told(self, name, start, end):
        asked.append(end - start)
        return whole(self, name, start, end)

    monkeypatch.setattr(Objects, "range", told)
    with open_location(url) as file:
        assert file.read() == data
        assert len(asked) < 10
        assert sum(asked) < len(data) + (1 << 16)
        asked.clear()
        for offset in (5 << 20, 1 << 20, 8 << 20):
            file.seek(offset)
            file.read(9)
        assert asked == [1 << 16] * 3


def test_an_empty_object_is_empty(bucket, tmp_path):
    put(bucket, tmp_path, "none", b"")
    assert bucket.open("none").read() == b""


def test_a_signed_address_of_a_web_server_is_read_and_not_told(bucket, tmp_path):
    put(bucket, tmp_path, "a.mcap", b"0123456789")
    signed = obstore.sign(bucket._store, "GET", "line 1/a.mcap", datetime.timedelta(minutes=1))
    place = to_location(signed)
    assert isinstance(place, RemoteFile)
    assert (place.name, place.stem) == ("a.mcap", "a")
    assert place.read_bytes() == b"0123456789"
    assert "Signature" in signed
    assert "?" not in f"{place} {place!r}"
    with pytest.raises(ObjectsUnusable, match=r"refused \(403 Forbidden") as refused:
        open_location(signed.partition("?")[0])
    assert "Signature" not in str(refused.value)


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("ftp://host/a.mcap", "ftp scheme is not known here"),
        ("http://host", "no file of a server is named"),
        ("http://host:port/a.mcap", "Port could not be cast"),
        ("file://host/a.mcap", "no file of this computer"),
        ("s3://bu!cket/a.mcap", "no name of a bucket"),
        ("s3://me:secret@bucket/a.mcap", "no name of a bucket"),
        ("s3://bucket/../a.mcap", "are no names"),
        ("s3://bucket/a//b.mcap", "are no names"),
        ("s3://bucket/%2e%2e/a.mcap", "are no names"),
        ("s3://bucket/a.mcap?key=secret", "'key' is not known"),
        ("s3://bucket/a.mcap?endpoint=http://me:secret@host", "names a password"),
        ("s3://bucket/a.mcap?region=secret@x", "no region"),
    ],
)
def test_a_wrong_url_is_refused_in_a_sentence(url, said):
    with pytest.raises(LocationRefused, match=f"{said}.*; allowed are file:///PATH, ") as refused:
        open_location(url)
    assert "me:" not in str(refused.value)


def test_who_does_not_answer_or_refuses_is_told_in_a_sentence(buckets, monkeypatch):
    nobody = "s3://bucket-0/a.mcap?endpoint=http://127.0.0.1:1"
    with pytest.raises(ObjectsUnusable, match=r"^s3://bucket-0/a.mcap: it does not answer"):
        open_location(nobody)
    missing = Objects(f"s3://no-such-bucket/a?endpoint={buckets.endpoint}")
    for ask in (missing.check, missing.open):
        with pytest.raises(ObjectsUnusable, match="there is no such bucket"):
            ask()
    with pytest.raises(ObjectsUnusable, match=r"^http://127.0.0.1:1/a.mcap: it does not answer") as said:
        open_location("http://me:secret@127.0.0.1:1/a.mcap?key=secret")
    assert "secret" not in str(said.value)
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    with pytest.raises(ObjectsUnusable, match="no credentials; set AWS_ACCESS_KEY_ID"):
        open_location(nobody)


def test_a_web_server_lists_nothing():
    with pytest.raises(LocationRefused, match="name each file"):
        list_locations("http://127.0.0.1:1/recordings", ".mcap")


def test_paths_stay_paths(tmp_path):
    (tmp_path / "a b.mcap").write_bytes(b"1")
    assert to_location(tmp_path) == tmp_path
    assert to_location(f"{tmp_path.as_uri()}/a%20b.mcap") == tmp_path / "a b.mcap"
    assert list_locations(str(tmp_path), ".mcap") == (tmp_path / "a b.mcap",)
    assert shown("s3://bucket/a?endpoint=x") == "s3://bucket/a"
