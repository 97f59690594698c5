"""Requests over HTTP that go again until they are answered, and answers that are what they should be."""

from __future__ import annotations

import json
import ssl
import time
from collections.abc import Callable, Mapping
from copy import copy
from typing import Any, cast
from urllib.parse import urlsplit
from uuid import uuid4

import httpx2

from inspector.client.errors import NotSendable, NotUnderstood, ServiceRefused, ServiceUnreachable

_FIRST_PAUSE, _LONGEST_PAUSE = 0.1, 2.0
"""Seconds between two tries; they double."""
BUSY = 503
_GATEWAY = (502, 504)
"""Said by what stands between, where the service is being started again."""
_BROKE_OFF = 500
"""Without a problem document: not the service's word, but of one that stands between, and lost it in the middle."""
_TOO_EARLY = 409
"""With `Retry-After`: the same request is being answered."""
_FULL = "urn:inspector:at-capacity"
_ABSENT = (httpx2.ConnectError, httpx2.ConnectTimeout)


class Patience:
    """How long to go on trying, from the first failure on; whatever succeeds renews it."""

    def __init__(self, seconds: float, clock: Callable[[], float], sleep: Callable[[float], object]) -> None:
        self._seconds, self._clock, self._sleep = seconds, clock, sleep
        self.renew()

    def renew(self) -> None:
        """There was an answer."""
        self._until: float | None = None
        self._tries = 0

    def again(self, wait: float | None = None) -> bool:
        """Wait before the next try, as long as asked or as usual; False, at once, where it is time to give up."""
        usual = min(_FIRST_PAUSE * 2 ** (self._tries - 1), _LONGEST_PAUSE) if self._tries else 0.0
        pause = usual if wait is None else wait
        now = self._clock()
        self._until = now + self._seconds if self._until is None else self._until
        if now + pause > self._until:
            return False
        if pause > 0:
            self._sleep(pause)
        self._tries += 1
        return True


class Asker:
    """One service, by its url and a token. Never by way of a proxy of the environment: a line asks its station."""

    def __init__(
        self,
        url: str,
        token: str | None,
        *,
        timeout: float,
        patience: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self.url, self.timeout, self.clock, self.sleep = _checked(url), timeout, clock, sleep
        self.headers = {} if token is None else {"Authorization": f"Bearer {_printable(token)}"}
        self.tls = ssl.create_default_context() if self.url.startswith("https:") else None
        self._patience = patience
        self._reached = False
        self._http = httpx2.Client(timeout=timeout, verify=self.tls or False, trust_env=False, follow_redirects=False)

    def of_session(self) -> Asker:
        """The same, over the same connections, for one inspection: every request says which, by an id chosen here."""
        asker = copy(self)
        asker.choose_session()
        return asker

    def choose_session(self) -> None:
        """Another id: what stands before several services finds one by it."""
        self.headers = self.headers | {"X-Session-Id": uuid4().hex}

    def patience(self) -> Patience:
        """A new one."""
        return Patience(self._patience, self.clock, self.sleep)

    def get(self, path: str, *names: str) -> dict[str, Any]:
        """An object that has these names, at least. Raises ServiceUnreachable, ServiceRefused, NotUnderstood."""
        return self.told(self.ask("GET", path), *names)

    def post(self, path: str, body: Mapping[str, object], *names: str, key: str | None = None) -> dict[str, Any]:
        """An order that is carried out once, however often it has to be sent. Answers and raises as `get` does."""
        return self.told(self.ask("POST", path, json=body, headers={"Idempotency-Key": key or uuid4().hex}), *names)

    def open_session(self, path: str, body: Mapping[str, object], *names: str) -> dict[str, Any]:
        """The same, for the order that begins the session; where its service is full, by another id at another one."""
        request: dict[str, Any] = {"json": body, "headers": {"Idempotency-Key": uuid4().hex}}
        return self.told(self.ask("POST", path, full=self.choose_session, **request), *names)

    def post_once(self, path: str, *names: str, **request: Any) -> dict[str, Any]:
        """An order that is sent once only. Answers and raises as `get` does."""
        return self.told(self._try("POST", path, **request), *names)

    def ask(
        self, method: str, path: str, *, full: Callable[[], object] | None = None, **request: Any
    ) -> httpx2.Response:
        """The answer, whatever it is; asked again where there is none, or the service is busy.

        Where there is no room for one more inspection, `full` is called, and it is asked again soon. Where nobody ever
        was there, nobody is waited for. Raises ServiceUnreachable.
        """
        patience = self.patience()
        while True:
            try:
                response = self._try(method, path, **request)
            except ServiceUnreachable as error:
                absent = not self._reached and isinstance(error.__cause__, _ABSENT)
                if absent or not patience.again():
                    raise
                continue
            wait = _retry_after(response.headers)
            if full is not None and _is_full(response):
                full()
                wait = None
            if not _comes_later(response) or not patience.again(wait):
                return response

    def told(self, response: httpx2.Response, *names: str) -> dict[str, Any]:
        """What a good answer says, an object with these names. Raises ServiceRefused, NotUnderstood."""
        if not response.is_success:
            raise self.refusal(response.status_code, response.content)
        said = _object(response.content)
        if said is None or not said.keys() >= set(names):
            raise NotUnderstood(self.url, response.status_code, response.text[:60])
        return said

    def refusal(self, status: int, body: bytes) -> ServiceRefused | NotUnderstood:
        """An answer that is a problem, as an error."""
        said = _object(body) or {}
        try:
            return ServiceRefused(status, said["title"], said["detail"], said["type"], said)
        except KeyError:
            return NotUnderstood(self.url, status, body[:60].decode("utf-8", "replace"))

    def close(self) -> None:
        """Let the connections go."""
        self._http.close()

    def _try(self, method: str, path: str, **request: Any) -> httpx2.Response:
        try:
            headers = self.headers | request.pop("headers", {})
            response = self._http.request(method, f"{self.url}{path}", headers=headers, **request)
        except httpx2.HTTPError as error:
            raise ServiceUnreachable(self.url, str(error) or type(error).__name__) from error
        self._reached = True
        return response


def _comes_later(response: httpx2.Response) -> bool:
    status = response.status_code
    if status == _BROKE_OFF:
        return "problem+json" not in response.headers.get("content-type", "")
    return status == BUSY or status in _GATEWAY or (status == _TOO_EARLY and "retry-after" in response.headers)


def _is_full(response: httpx2.Response) -> bool:
    return response.status_code == BUSY and (_object(response.content) or {}).get("type") == _FULL


def _retry_after(headers: Mapping[str, str]) -> float | None:
    """Seconds; None where nothing is said, or a date."""
    said = headers.get("retry-after", "")
    return float(said) if said.isascii() and said.isdecimal() else None


def _object(body: bytes) -> dict[str, Any] | None:
    try:
        said = json.loads(body)
    except ValueError:
        return None
    return cast(dict[str, Any], said) if isinstance(said, dict) else None


def _checked(url: str) -> str:
    """Without the slash at its end. Raises NotSendable."""
    allowed = "allowed is http://HOST:PORT or https://HOST:PORT"
    try:
        parts = urlsplit(url)
        named = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError as error:
        raise NotSendable(f"url {url!r}", f"{error}; {allowed}") from error
    if "@" in parts.netloc:
        raise NotSendable("a url with a name or password in it", f"{allowed}, and a token beside it")
    if not named or parts.query or parts.fragment:
        raise NotSendable(f"url {url!r}", allowed)
    return url.rstrip("/")


def _printable(token: str) -> str:
    if not token or not token.isascii() or not token.isprintable() or " " in token:
        raise NotSendable("the token", "allowed are letters, digits and signs, without blanks")
    return token
