"""Objects by URL: what buckets of an S3 service and web servers hold. The only place that knows obstore.

    s3://BUCKET/PREFIX[?endpoint=http://HOST:PORT][&region=REGION]    credentials: AWS_ACCESS_KEY_ID and so on
    http://HOST/PATH, https://HOST/PATH                               only to read

inspector.errors.WorldError
└── ObjectError              what is read or written by URL did not do what was asked
    ├── LocationRefused      a URL that names no object here
    ├── NoSuchObject         there is nothing by that name
    ├── ObjectTaken          a name that something has already
    └── ObjectsUnusable      who holds the objects does not answer, or refuses: no such bucket, wrong credentials
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO
from urllib.parse import SplitResult, parse_qsl, unquote, urlsplit

import obstore
from obstore.exceptions import AlreadyExistsError, BaseError
from obstore.store import HTTPStore, S3Store

from inspector.errors import WorldError

if TYPE_CHECKING:
    from obstore import GetOptions, GetResult
    from obstore.store import ClientConfig, RetryConfig, S3Config

_BUCKET = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{1,62}")
_ENDPOINT = re.compile(r"https?://([A-Za-z0-9.-]+|\[[0-9A-Fa-f:.]+\])(:\d{1,5})?(/[A-Za-z0-9._~/-]*)?")
_REGION = re.compile(r"[a-z0-9-]{1,64}")
_STATUS = re.compile(r"non-2xx status code: (\d{3}[A-Za-z ]*)")
_CODE = re.compile(r"<Code>([A-Za-z0-9]{1,64})</Code>")
_CONDITION_REFUSED = "non-2xx status code: 501"
_CLIENT: ClientConfig = {"allow_http": True, "connect_timeout": timedelta(seconds=5), "timeout": timedelta(seconds=60)}
_RETRIES: RetryConfig = {"max_retries": 4, "retry_timeout": timedelta(seconds=20)}
_FIRST, _MOST = 1 << 16, 1 << 22
"""Bytes that are asked for at once: after a jump, and when reading on and on."""
_AT_ONCE = 64 << 20
"""What is larger is written in parts."""


class ObjectError(WorldError):
    """What is read or written by URL did not do what was asked."""


class LocationRefused(ObjectError):
    """A URL that names no object here."""

    def __init__(self, url: str, why: str) -> None:
        allowed = "file:///PATH, http(s)://HOST/PATH, s3://BUCKET/PATH, s3://BUCKET/PATH?endpoint=http://HOST:PORT"
        super().__init__(f"{shown(url)}: {why}; allowed are {allowed}")


class NoSuchObject(ObjectError):
    """There is nothing by that name."""

    def __init__(self, place: str) -> None:
        super().__init__(f"{place}: there is nothing by that name")


class ObjectTaken(ObjectError):
    """A name that something has already."""

    def __init__(self, place: str) -> None:
        super().__init__(f"{place} exists already, and nothing is written over")


class ObjectsUnusable(ObjectError):
    """Who holds the objects does not answer, or refuses."""

    def __init__(self, place: str, why: str) -> None:
        super().__init__(f"{place}: {why}")


@dataclass(frozen=True)
class _Place:
    """What a URL means."""

    scheme: str
    base: str
    """The bucket, or the web server with all that is in front of its path."""
    path: str
    endpoint: str | None = None
    region: str | None = None


def shown(url: str) -> str:
    """A URL without what nobody needs to see: its password and its query, which may be a signature.

    >>> shown("https://me:secret@example.com/a.mcap?X-Amz-Signature=0123")
    'https://example.com/a.mcap'
    """
    scheme, _, rest = url.partition("://")
    host, slash, path = rest.partition("/")
    return f"{scheme}://{host.rpartition('@')[2]}{slash}{path}".partition("?")[0].partition("#")[0]


def beneath(url: str, name: str) -> str:
    """The URL of what has that name under another one.

    >>> beneath("s3://bucket/line?endpoint=http://localhost:9000", "sweeps/1.mcap")
    's3://bucket/line/sweeps/1.mcap?endpoint=http://localhost:9000'
    """
    path, mark, query = url.partition("?")
    return f"{path.rstrip('/')}/{name}{mark}{query}"


class Objects:
    """All that is beneath one URL. Names are relative to it; "" is what the URL itself names. Everything here blocks.

    Raises LocationRefused where the URL cannot be, and ObjectsUnusable in every method.
    """

    def __init__(self, url: str) -> None:
        place = _parsed(url)
        self.url = url
        self._name, self._prefix, self._s3 = shown(url), place.path, place.scheme == "s3"
        with self._told(""):
            self._store = _store(
                place.scheme, place.base, place.endpoint, place.region, tuple(sorted(_credentials().items()))
            )

    def open(self, name: str = "") -> BinaryIO:
        """To read and to seek in; nothing is fetched but what is read, and some ahead. Raises NoSuchObject."""
        return io.BufferedReader(_Ranges(self, name), _MOST)

    def range(self, name: str, start: int, end: int) -> tuple[bytes, int]:
        """What is from byte `start` to byte `end`, without it, as far as it is there; and the size of the whole.

        Raises NoSuchObject.
        """
        with self._told(name):
            try:
                got = obstore.get(self._store, self._key(name), options={"range": (start, end)})
                return got.bytes().to_bytes(), got.meta["size"]
            except BaseError as error:
                # An empty object has no range, not even an empty one.
                if "416" not in str(error):
                    raise
        size = self.size(name)
        if size is None:
            raise NoSuchObject(self._at(name))
        return b"", size

    def stream(self, name: str, start: int = 0, end: int | None = None) -> tuple[int, Iterator[bytes]]:
        """Its size, and what is in it from `start` to `end`, without that, in pieces. Raises NoSuchObject."""
        options: GetOptions = {}
        if end is not None:
            options["range"] = (start, end)
        elif start:
            options["range"] = {"offset": start}
        with self._told(name):
            got = obstore.get(self._store, self._key(name), options=options)
        return got.meta["size"], self._pieces(name, got)

    def _pieces(self, name: str, got: GetResult) -> Iterator[bytes]:
        with self._told(name):
            yield from got.stream(min_chunk_size=1 << 20)

    def size(self, name: str = "") -> int | None:
        """Bytes; None where there is nothing by that name, nor perhaps a bucket."""
        try:
            with self._told(name):
                return obstore.head(self._store, self._key(name))["size"]
        except NoSuchObject:
            return None

    def version(self, name: str = "") -> tuple[int, str]:
        """Its size, and what is another when it is written again. Raises NoSuchObject."""
        with self._told(name):
            found = obstore.head(self._store, self._key(name))
        return found["size"], found["e_tag"] or found["last_modified"].isoformat()

    def put_new(self, name: str, path: Path) -> None:
        """The file, whole, by a name that nothing has. Raises ObjectTaken, OSError where the file cannot be read.

        Of two who write at once one is refused, where the service knows conditional writes. Else, and for what is
        larger than 64 MiB, which goes in parts and is there when the last one is, the name is only looked up before.
        """
        if self.size(name) is not None:
            raise ObjectTaken(self._at(name))
        key = self._key(name)
        with self._told(name), path.open("rb") as file:
            if path.stat().st_size > _AT_ONCE:
                obstore.put(self._store, key, file, chunk_size=_AT_ONCE // 4, max_concurrency=2)
                return
            data = file.read()
            try:
                obstore.put(self._store, key, data, mode="create")
            except BaseError as error:
                if _CONDITION_REFUSED not in str(error):
                    raise
                obstore.put(self._store, key, data)

    def remove(self, name: str) -> None:
        """Nothing is there afterwards; it does not matter whether something was."""
        try:
            with self._told(name):
                obstore.delete(self._store, self._key(name))
        except NoSuchObject:
            return

    def names(self, ending: str = "") -> Iterator[tuple[str, int]]:
        """Names and sizes of all that end so, in order of names. Raises LocationRefused for a web server."""
        if not self._s3:
            raise LocationRefused(self.url, "a web server lists nothing; name each file")
        # A folder is what ends with a slash: "line-1" is not to list "line-10".
        prefix = f"{self._prefix}/" if self._prefix else ""
        with self._told(""):
            for batch in obstore.list(self._store, prefix=prefix or None):
                for each in sorted(batch, key=lambda found: found["path"]):
                    if each["path"].endswith(ending):
                        yield each["path"].removeprefix(prefix), each["size"]

    def check(self) -> None:
        """Raises ObjectsUnusable where nothing can be asked."""
        with self._told(""):
            next(iter(obstore.list(self._store, prefix=self._key("none") or None, chunk_size=1)), None)

    def _key(self, name: str) -> str:
        return "/".join(part for part in (self._prefix, name) if part)

    def _at(self, name: str) -> str:
        return shown(beneath(self.url, name)) if name else self._name

    @contextmanager
    def _told(self, name: str) -> Generator[None]:
        """What goes wrong, in a sentence of ours: that of the library quotes URLs, and all that is in them."""
        try:
            yield
        except AlreadyExistsError as error:
            raise ObjectTaken(self._at(name)) from error
        except FileNotFoundError as error:
            if "NoSuchBucket" in str(error):
                raise ObjectsUnusable(self._at(name), self._why(str(error))) from None
            raise NoSuchObject(self._at(name)) from None
        except BaseError as error:
            raise ObjectsUnusable(self._at(name), self._why(str(error))) from None

    def _why(self, said: str) -> str:
        status, code = _STATUS.search(said), _CODE.search(said)
        if "NoSuchBucket" in said:
            return "there is no such bucket; make it, or name another"
        if "/latest/api/token" in said or "/latest/meta-data" in said or "Missing" in said.partition("\n")[0]:
            return "no credentials; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY in the environment"
        if "Range request not supported" in said:
            return "the server sends files only as a whole; allowed are servers that send ranges of bytes"
        if status is None:
            return "it does not answer; is the address right, and does it run?"
        answer = f"{status[1].strip()}{f', {code[1]}' if code else ''}"
        if status[1].startswith(("401", "403")):
            hint = "are the credentials in the environment right (AWS_ACCESS_KEY_ID, ...), and may they do this?"
            return f"refused ({answer}); {hint if self._s3 else 'may you read it?'}"
        return f"the server answered {answer}"


class _Ranges(io.RawIOBase):
    """An object as a file. Reads a little after a jump, and more and more at once while it is read on and on."""

    def __init__(self, objects: Objects, name: str) -> None:
        super().__init__()
        self._objects, self._name = objects, name
        self._held, self._size = objects.range(name, 0, _FIRST)
        self._start = self._at = 0
        self._next = 2 * _FIRST

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        self._at = max(0, base + offset)
        return self._at

    def readinto(self, buffer: Any, /) -> int:
        wanted = memoryview(buffer)
        if self._at >= self._size or not wanted:
            return 0
        skip = self._at - self._start
        if not 0 <= skip < len(self._held):
            self._fetch(skip)
            skip = 0
        piece = memoryview(self._held)[skip : skip + len(wanted)]
        wanted[: len(piece)] = piece
        self._at += len(piece)
        return len(piece)

    def _fetch(self, skip: int) -> None:
        self._next = min(2 * self._next, _MOST) if skip == len(self._held) else _FIRST
        end = min(self._at + self._next, self._size)
        self._held, size = self._objects.range(self._name, self._at, end)
        self._start = self._at
        if size != self._size or len(self._held) != end - self._at:
            raise ObjectsUnusable(shown(beneath(self._objects.url, self._name)), "it changed while it was read")


def _credentials() -> dict[str, str]:
    """What the library reads of the environment."""
    return {name: value for name, value in os.environ.items() if name.startswith("AWS_")}


@lru_cache(maxsize=32)
def _store(
    scheme: str, base: str, endpoint: str | None, region: str | None, credentials: tuple[tuple[str, str], ...]
) -> S3Store | HTTPStore:
    """With its connections, for all who ask there by the same `credentials`; a new one costs some milliseconds."""
    if scheme != "s3":
        return HTTPStore.from_url(base, client_options=_CLIENT, retry_config=_RETRIES)
    config: S3Config = {}
    if endpoint is not None:
        config["endpoint"] = endpoint
    if region is not None:
        config["region"] = region
    return S3Store(base, config=config, client_options=_CLIENT, retry_config=_RETRIES)


def _parsed(url: str) -> _Place:
    try:
        split = urlsplit(url)
        # Asked for here, because it may raise.
        _ = split.port
    except ValueError as error:
        raise LocationRefused(url, str(error)) from error
    if any(part in (".", "..") for part in unquote(split.path).split("/")) or "//" in split.path.rstrip("/"):
        raise LocationRefused(url, "'.', '..' and '//' are no names")
    if split.scheme == "s3":
        return _bucket(url, split)
    if split.scheme not in ("http", "https"):
        raise LocationRefused(url, f"{split.scheme or 'no'} scheme is not known here")
    if not split.hostname or not split.path.strip("/"):
        raise LocationRefused(url, "no file of a server is named")
    query = f"?{split.query}" if split.query else ""
    return _Place(split.scheme, f"{split.scheme}://{split.netloc}/{query}", unquote(split.path).strip("/"))


def _bucket(url: str, split: SplitResult) -> _Place:
    if not _BUCKET.fullmatch(split.netloc):
        raise LocationRefused(url, f"{shown(f's3://{split.netloc}')[5:]!r} is no name of a bucket")
    query = dict(parse_qsl(split.query, keep_blank_values=True))
    if wrong := sorted(query.keys() - {"endpoint", "region"}):
        raise LocationRefused(url, f"{wrong[0]!r} is not known; known are endpoint and region")
    endpoint, region = query.get("endpoint"), query.get("region")
    if endpoint is not None and not _ENDPOINT.fullmatch(endpoint):
        raise LocationRefused(url, "the endpoint is no address of a service, or names a password")
    if region is not None and not _REGION.fullmatch(region):
        raise LocationRefused(url, f"{region!r} is no region")
    return _Place("s3", split.netloc, split.path.strip("/"), endpoint and endpoint.rstrip("/"), region)
