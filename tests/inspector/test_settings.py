"""Settings: from options, then the environment; what is not allowed is named; every one is documented."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from inspector.settings import SettingRefused, Settings, is_loopback, read_settings
from tests.system.repository import texts


def test_what_is_given_goes_before_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INSPECTOR_PORT", "8080")
    monkeypatch.setenv("INSPECTOR_CAMERAS", '{"top": "opencv:0"}')
    assert (read_settings().port, read_settings(port=9).port, read_settings(port=None).port) == (8080, 9, 8080)
    assert read_settings().cameras == {"top": "opencv:0"}


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("port", 65536, r"^setting port is 65536: it should be less than or equal to 65535$"),
        ("max_body", 0, "setting max_body is 0: it should be greater than or equal to 1"),
        ("cameras", {"a/b": "rtsp://me:secret@there"}, "^setting cameras: Value error, 'a/b' is no name: [^@]*$"),
        ("log_level", "loud", "setting log_level is 'loud'"),
        ("nonsense", 1, "setting nonsense is 1"),
    ],
)
def test_what_is_not_allowed_is_named(name: str, value: object, said: str) -> None:
    with pytest.raises(SettingRefused, match=said):
        read_settings(**{name: value})


def test_the_environment_must_be_json_where_a_setting_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INSPECTOR_CAMERAS", "opencv:0")
    with pytest.raises(SettingRefused, match="cameras"):
        read_settings()


def test_they_never_change() -> None:
    with pytest.raises(ValidationError):
        read_settings().port = 1


@pytest.mark.parametrize(
    ("host", "asked", "asks"),
    [
        ("127.0.0.1", None, False),
        ("::1", None, False),
        ("0.0.0.0", None, True),
        ("10.0.0.7", None, True),
        ("127.0.0.1", True, True),
        ("10.0.0.7", False, False),
    ],
)
def test_a_token_is_asked_for_everywhere_but_on_loopback(host: str, asked: bool | None, asks: bool) -> None:
    assert read_settings(host=host, require_token=asked).asks_for_tokens is asks


@pytest.mark.parametrize("host", ["127.0.0.1.example.com", "localhost.", "1127.0.0.1", "", "::", "127.0.0.1:80"])
def test_only_loopback_is_loopback(host: str) -> None:
    assert not is_loopback(host)


def test_a_password_is_not_shown() -> None:
    settings = read_settings(database="postgresql://me:secret@there/db")
    assert "secret" not in repr(settings)
    assert settings.database_url == "postgresql://me:secret@there/db"


def test_every_setting_is_documented() -> None:
    page = texts()["api/README.md"]
    assert [name for name in Settings.model_fields if f"| `{name}` |" not in page] == []
