"""What a station sets of the service: read once from options and `INSPECTOR_*`, then handed down as a frozen value.

inspector.errors.WorldError
└── SettingRefused           a setting whose value is not allowed
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, SecretStr, ValidationError, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict, SettingsError

from inspector.errors import WorldError

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
"""What products and cameras may be called."""
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]


class SettingRefused(WorldError):
    """A setting whose value is not allowed."""

    def __init__(self, name: str, value: object, why: str) -> None:
        # Of more than a number or a word only the name is told: addresses of cameras hold passwords.
        shown = f" is {value!r}" if isinstance(value, int | float | str) else ""
        super().__init__(f"setting {name}{shown}: {why}")


class Settings(BaseSettings):
    """Every setting of the service. Each may be given in the environment: `INSPECTOR_PORT=8080`."""

    model_config = SettingsConfigDict(env_prefix="INSPECTOR_", frozen=True, extra="forbid")

    data: Path = Path("inspector-data")
    """Folder of the store, the recordings and what was learnt; made where it is missing."""
    files: str | None = None
    """URL where finished files are kept: `s3://…`, `file:///…`; None is the data folder."""
    database: SecretStr | None = None
    """URL of the database; None is SQLite in the data folder."""
    host: str = "127.0.0.1"
    """Address to listen at."""
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    """0 takes a free one."""
    tls_cert: Path | None = None
    """Certificate (PEM); with it, the service speaks HTTPS."""
    tls_key: Path | None = None
    """Private key (PEM) of the certificate, where that does not hold it."""
    require_token: bool | None = None
    """Whether who asks must show a token; None asks for one everywhere but on loopback."""

    scorers: Count = CORES
    """Processes that score."""
    max_inspections: Count = 8 * CORES
    """Inspections at once; one more is refused."""
    window: Count = 32
    """Frames of one inspection that may wait to be scored."""
    idle_seconds: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 60.0
    """An inspection without a frame for so long is aborted."""

    max_body: Count = 32 << 20
    """Bytes of one picture."""
    max_recording: Count = 8 << 30
    """Bytes of one recording that is uploaded."""
    max_pixels: Count = 64_000_000
    """Of one picture, as its header announces; checked before it is decoded."""
    max_frames: Count = 100_000
    """Of one inspection, or of one recording."""
    max_subscribers: Count = 64
    """Listeners to events at once."""

    keep_ok_one_in: Count = 1
    """Of the recordings of parts that are OK, one in so many is kept; of all others every one."""
    keep_days: Annotated[float, Field(gt=0)] = 30.0
    """Recordings of inspections are removed after so many days."""
    keep_disk_share: Share = 0.8
    """Share of the room that recordings and the free disk make up; beyond it they are removed, the oldest OK first."""

    keep_bytes: Count | None = None
    """Bytes that recordings of inspections may fill, wherever they are; None is no limit but the disk."""
    keep_scores_days: Annotated[float, Field(gt=0)] = 90.0
    """Scores of frames are removed so many days after their inspection; its result stays. `inf`: never."""

    executor: Annotated[str, Field(pattern=r"^(serial|processes(:[1-9]\d*)?|dask://.+|ray://.+)$")] = (
        f"processes:{max(1, CORES // 2)}"
    )
    """Where batches are done, and three golden sweeps or more are learnt: `serial`, `processes:N` beside this service,
    `dask://HOST:PORT`, `ray://auto`.
    """

    cameras: dict[str, str] = Field(default_factory=dict)
    """Cameras that sweeps can be recorded from, by name. JSON in the environment: `{"top": "opencv:0"}`."""
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    """What is logged: this, and what is worse."""

    @field_validator("cameras")
    @classmethod
    def _named(cls, cameras: dict[str, str]) -> dict[str, str]:
        for name in cameras:
            if not NAME.fullmatch(name):
                raise ValueError(
                    f"{name!r} is no name: 1 to 64 letters, digits, '.', '_', '-', a letter or digit first"
                )
        return cameras

    @property
    def on_loopback(self) -> bool:
        """Whether only this computer can reach the service."""
        return is_loopback(self.host)

    @property
    def asks_for_tokens(self) -> bool:
        """Whether who asks must show a token."""
        return not self.on_loopback if self.require_token is None else self.require_token

    @property
    def database_url(self) -> str:
        """Of the store; may hold a password."""
        if self.database is None:
            return f"sqlite:{self.data / 'service.sqlite'}"
        return self.database.get_secret_value()


def is_loopback(host: str) -> bool:
    """Whether a host, without its port, is this computer and nothing else.

    >>> [is_loopback(host) for host in ("127.0.0.1", "localhost", "::1", "0.0.0.0", "localhost.example.com")]
    [True, True, True, False, False]
    """
    return host.lower() in ("localhost", "::1", "[::1]") or re.fullmatch(r"127(\.\d{1,3}){3}", host) is not None


def read_settings(**given: object) -> Settings:
    """The settings: those given, else those of the environment, else the usual ones; None is not given.

    Raises SettingRefused, which names the first that is not allowed.
    """
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})  # pyright: ignore[reportArgumentType]
    except SettingsError as error:
        raise SettingRefused("in the environment", None, f"{error}; allowed is JSON") from error
    except ValidationError as error:
        wrong = error.errors(include_url=False)[0]
        name = ".".join(str(part) for part in wrong["loc"])
        raise SettingRefused(name, wrong["input"], wrong["msg"].replace("Input should", "it should")) from error
