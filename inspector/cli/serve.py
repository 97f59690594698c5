"""`inspector serve`: the HTTP service."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def serve(
    *,
    data: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for everything. [default: inspector-data]")
    ] = None,
    host: Annotated[str | None, typer.Option(help="Address to listen at. [default: 127.0.0.1]")] = None,
    port: Annotated[int | None, typer.Option(help="0 takes a free one. [default: 8000]")] = None,
    database: Annotated[
        str | None, typer.Option(metavar="URL", help="postgresql://...; usually SQLite in the folder.")
    ] = None,
    require_token: Annotated[
        bool | None, typer.Option(help="Ask for a token; usually everywhere but on loopback.", show_default=False)
    ] = None,
    tls_cert: Annotated[Path | None, typer.Option(metavar="CERT.pem", help="Speak HTTPS.")] = None,
    tls_key: Annotated[Path | None, typer.Option(metavar="KEY.pem", help="The certificate's private key.")] = None,
    camera: Annotated[
        list[str] | None, typer.Option(metavar="NAME=URL", help="A camera that sweeps can be recorded from.")
    ] = None,
) -> None:
    """Serve: frames in, verdicts out, by REST and WebSocket. Ctrl-C ends it properly.

    Every other setting is an environment variable, INSPECTOR_NAME; api/README.md lists them.

    Example: inspector serve --data station-1
    """
    from inspector.serving import serve as serve_until_stopped
    from inspector.settings import read_settings

    settings = read_settings(
        data=data, host=host, port=port, database=database, require_token=require_token,
        tls_cert=tls_cert, tls_key=tls_key, cameras=_named(camera or []) or None,
    )  # fmt: skip
    serve_until_stopped(
        settings, lambda url: print(f"inspector serves at {url}; documentation at {url}/docs", flush=True)
    )


def _named(cameras: list[str]) -> dict[str, str]:
    for camera in cameras:
        if not camera.partition("=")[2]:
            raise typer.BadParameter(f"--camera {camera.partition('=')[0]!r} is not allowed; allowed is NAME=URL")
    return {name: url for name, _, url in (camera.partition("=") for camera in cameras)}
