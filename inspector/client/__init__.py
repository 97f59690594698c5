"""The client of a service: a line in Python. The only room that knows HTTP and WebSocket from the asking side.

    from inspector.client import Client

    with Client("http://127.0.0.1:8000") as client, client.begin("plate", "0007") as inspection:
        for frame in camera.frames():
            inspection.send(frame)
        result = inspection.conclude()
    print(result["verdict"])

Nothing is lost and nothing is scored twice where a connection breaks: frames have numbers, and go again until they are
answered. What is raised is a `ClientError`, one sentence. A client may be used from several threads, an inspection
belongs to one.
"""

from inspector.client.base import AbstractInspection, OnMessage
from inspector.client.client import TRANSPORTS, Client
from inspector.client.errors import (
    ClientError,
    InspectionEnded,
    NotSendable,
    NotUnderstood,
    ServiceRefused,
    ServiceUnreachable,
)
from inspector.client.pace import paced

__all__ = [
    "TRANSPORTS",
    "AbstractInspection",
    "Client",
    "ClientError",
    "InspectionEnded",
    "NotSendable",
    "NotUnderstood",
    "OnMessage",
    "ServiceRefused",
    "ServiceUnreachable",
    "paced",
]
