"""Cameras: everything that delivers frames, chosen by url: `open_camera("simulated:?part=board&defect=scratch")`."""

from __future__ import annotations

from importlib import import_module

from inspector.cameras.base import AbstractCamera, Clock, UnknownCamera, split_url

CAMERAS = {
    "simulated": "inspector.cameras.simulated:SimulatedCamera",
    "folder": "inspector.cameras.folder:FolderCamera",
    "opencv": "inspector.cameras.opencv:OpenCVCamera",
}
"""Scheme -> import string; a camera is imported when it is chosen, so an extra that nobody uses need not be there."""

__all__ = ["CAMERAS", "AbstractCamera", "Clock", "open_camera"]


def open_camera(url: str, clock: Clock | None = None) -> AbstractCamera:
    """The camera that the url names, open; `clock` replaces the machine's own for live sources and pacing.

    Raises CameraError: an unknown scheme or option, a value that is not allowed, a source that cannot be opened.
    """
    scheme, place, query = split_url(url)
    if scheme not in CAMERAS:
        raise UnknownCamera(url, tuple(CAMERAS))
    module, _, name = CAMERAS[scheme].partition(":")
    camera: type[AbstractCamera] = getattr(import_module(module), name)
    return camera.open(place, query, clock or Clock())
