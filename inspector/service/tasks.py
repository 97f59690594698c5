"""What is done on the desk, in a process of its own: surveys, recording, learning, replays, judging again, pictures.

Each task takes JSON values and a `progress` to call with the share done, and returns JSON values.

inspector.errors.RecordingError
└── TooManyFrames            a recording of more frames than allowed
"""

from __future__ import annotations

import hashlib
import json
from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from inspector.cameras import open_camera
from inspector.cameras.base import waits
from inspector.errors import RecordingError
from inspector.executors import open_executor
from inspector.files import write_new
from inspector.labels import read_recording
from inspector.learner import add_recordings, learn_recordings, load_appearance
from inspector.pictures import decode
from inspector.recorder import RecordingSummary
from inspector.recorder import record as record_sweep
from inspector.recording import SweepReader, count_frames
from inspector.result_json import recognised_record
from inspector.scores_json import scores_from_bytes
from inspector.service import showing
from inspector.service.archives import BEGINS, read_archive
from inspector.service.replaying import OTHERS, batch, others_of, replay
from inspector.service.showing import load_cached
from inspector.workspaces import learn_labels, load_workspace
from models.appearance import Appearance
from models.drift import changes
from models.errors import LearningError
from models.excused import excused
from models.frame import EncodedPicture
from models.judging import judge, rescaled
from models.limits import promise
from models.recognition import recognise as recognise_part
from models.verdict import Policy, Result, ScoredFrame
from models.workspace import Workspace

Progress = Callable[[float], None]
Json = dict[str, Any]
_MANY = 3
"""Golden sweeps: the first is read here, and two or more of the others at once."""
_ALONE = ("serial", "processes:1")
"""Executors that would do no more than this process."""


class TooManyFrames(RecordingError):
    """A recording of more frames than allowed."""

    def __init__(self, path: object, allowed: int) -> None:
        super().__init__(f"{path}: more frames than allowed; allowed are {allowed}")


def survey(progress: Progress, *, recording: str, max_frames: int, max_pixels: int) -> Json:
    """What a recording holds, every frame of it read. Raises RecordingError."""
    reader, count = SweepReader(recording, max_pixels=max_pixels), 0
    announced = count_frames(reader.path)
    for _ in reader:
        count += 1
        if count > max_frames:
            raise TooManyFrames(reader.path, max_frames)
        if announced:
            progress(min(1.0, count / announced))
    return {"frames": count, "losses": list(reader.losses), "facts": dict(reader.facts)}


def record(
    progress: Progress,
    *,
    camera: str,
    recording: str,
    seconds: float | None,
    frames: int | None,
    product_id: str,
    part_id: str | None,
) -> Json:
    """A camera's sweep as a recording. Raises CameraError, RecordingError."""

    def tell(so_far: RecordingSummary) -> None:
        progress(min(1.0, so_far.frames / frames if frames else so_far.seconds / (seconds or 1.0)))

    with open_camera(camera) as source:
        summary = record_sweep(
            source, recording, seconds=seconds, frames=frames, product_id=product_id, part_id=part_id,
            lossless=waits(camera), on_progress=tell,
        )  # fmt: skip
    lost = [f"{summary.drops} frames came faster than the disk took them"] if summary.drops else []
    with Path(recording).open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return {"frames": summary.frames, "bytes": summary.bytes, "sha256": sha256, "losses": lost}


def learn(
    progress: Progress,
    *,
    sweeps: Sequence[str],
    appearance: str,
    add_to: str | None,
    ignore: str | None,
    executor: str = "serial",
) -> Json:
    """Golden sweeps as an appearance, as `inspector learn` makes it. Raises LearningError, RecordingError.

    By an executor where there are many; raises as `open_executor` does then, and WorkersLost.
    """
    said: list[str] = []
    if add_to is not None:
        learnt = add_recordings(sweeps, add_to, appearance, progress, tell=said.append)
    elif len(sweeps) < _MANY or executor in _ALONE:
        learnt = learn_recordings(sweeps, appearance, progress, ignore=ignore, tell=said.append)
    else:
        with open_executor(executor) as workers:
            learnt = learn_recordings(
                sweeps, appearance, progress, ignore=ignore, tell=said.append, executor=workers
            )  # fmt: skip
    return _learnt(learnt, appearance, said)


def excuse(progress: Progress, *, of: str, regions: Sequence[Mapping[str, float]], appearance: str) -> Json:
    """An appearance that tolerates everything in rectangles of the part. Raises LearningError, AppearanceError."""
    old = learnt = load_appearance(of)
    width, height = old.size
    for number, each in enumerate(regions, start=1):
        x, y, across, down = (int(each[name]) for name in ("x", "y", "width", "height"))
        if x + across > width or y + down > height:
            raise LearningError(f"region {number} ends at ({x + across}, {y + down}); the picture is {width}x{height}")
        region = np.zeros((height, width), bool)
        region[y : y + down, x : x + across] = True
        learnt = excused(learnt, old.key_at(float(each["s"])), region)
        progress(number / len(regions))
    before: list[Json] = json.loads(old.facts.get("excused", "[]"))
    count = int(old.facts.get("excused_regions", "0")) + len(regions)
    said = {"excused_regions": str(count), "excused": json.dumps([*before, *regions], separators=(",", ":"))}
    facts = {**old.facts, "excused_from": old.id, **said}
    learnt = replace(learnt, facts=facts)
    write_new(Path(appearance), learnt.to_bytes())
    return _learnt(learnt, appearance, [])


def _learnt(learnt: Appearance, appearance: str, said: list[str]) -> Json:
    return {
        "appearance_id": learnt.id,
        "facts": _facts(learnt),
        "said": said,
        "bytes": Path(appearance).stat().st_size,
    }


def _facts(learnt: Appearance) -> Json:
    (width, height), mask = learnt.size, learnt.preparation.ignore
    promised = promise(learnt.peaks, Policy.false_rejects)
    return {
        **learnt.facts,
        "places": learnt.places,
        "ignored": 0.0 if mask is None else round(float(np.mean(mask)), 4),
        "width": width,
        "height": height,
        "promise": {name: round(value, 6) for name, value in asdict(promised).items()},
        "promised": promised.sentence(),
    }


def recognise(progress: Progress, *, own: str, others: Mapping[str, str], pictures: Sequence[str]) -> Json:
    """What pictures of a sweep show, that does not begin as its part does: `recognised`, null where nobody knows."""
    seen = [decode(EncodedPicture("", b64decode(picture))) for picture in pictures]
    known, asked = others_of(others), OTHERS.load(Path(own))
    found = recognise_part(asked, seen, known)
    return {"recognised": None if found is None else {**recognised_record(found), "sentence": found.sentence()}}


def rejudge(
    progress: Progress, *, appearance: str, policy: Mapping[str, float], inspections: Sequence[Mapping[str, Any]]
) -> Json:
    """What the stored scores of inspections by this appearance come to with another policy."""
    learnt, now = load_cached(appearance), Policy(**policy)
    found: list[Json] = []
    for each in inspections:
        result = rejudged(
            scores_from_bytes(b64decode(each["scores"])), learnt, Policy(**each["policy"]), now,
            dropped=each["dropped"], stopped=each["stopped"],
        )  # fmt: skip
        scored = [frame.score for frame in result.frames]
        found.append(
            {
                "inspection_id": each["inspection_id"],
                "now": result.verdict.value,
                "reasons": list(result.reasons),
                "deviations": len(result.deviations),
                "highest_score": round(max(scored, default=0.0), 6),
            }
        )
        progress(len(found) / len(inspections))
    return {"inspections": found}


def rejudged(
    frames: Sequence[ScoredFrame], appearance: Appearance, before: Policy, now: Policy, *, dropped: int, stopped: bool
) -> Result:
    """The verdict on frames that were scored under one policy, under another; `digest` stays empty.

    Scores go with the inverse of the limits' factor, which target and sensitivity set.
    """
    by = _factor(appearance, before) / _factor(appearance, now)
    # Scaling by one and the same factor would change nothing, and must not: not even a region's last bit.
    again = frames if by == 1.0 else rescaled(frames, by)
    return judge(
        again, now, appearance.s, appearance.path,
        appearance_id=appearance.id, dropped=dropped, digest="", stopped=stopped,
    )  # fmt: skip


def _factor(appearance: Appearance, policy: Policy) -> float:
    return promise(appearance.peaks, policy.false_rejects).factor / policy.sensitivity


def picture(
    progress: Progress,
    *,
    recording: str,
    index: int,
    kind: str,
    appearance: str,
    policy: Mapping[str, float],
    scored: str | None,
) -> Json:
    """`format` and `data`; or `missing`, a sentence, where there is no such picture. `scored` is of one frame."""
    frames = scores_from_bytes(b64decode(scored)) if scored is not None else ()
    made = showing.picture(
        recording=recording, index=index, kind=kind, appearance=appearance, policy=Policy(**policy),
        scored=frames[0] if frames else None,
    )  # fmt: skip
    if isinstance(made, str):
        return {"missing": made}
    return {"format": made.format, "data": b64encode(made.data).decode()}


def sampling(progress: Progress, *, appearance: str) -> Json:
    """How densely an appearance's reference sweep shows the part."""
    return showing.sampling_of(appearance)


def reference(progress: Progress, *, appearance: str, s: float) -> Json:
    """The reference picture there: `format`, `data`, `place` and `s`."""
    picture, place, at = showing.reference(appearance, s)
    return {"format": picture.format, "data": b64encode(picture.data).decode(), "place": place, "s": round(at, 6)}


def ignored(progress: Progress, *, appearance: str, s: float) -> Json:
    """What was learnt not to be looked at there: `format` and `data`."""
    picture = showing.ignored(appearance, s)
    return {"format": picture.format, "data": b64encode(picture.data).decode()}


def drift(progress: Progress, *, profiles: Sequence[Sequence[float | None]]) -> Json:
    """Where and since when the profiles of parts, oldest first, moved; the medians before and after."""
    known = np.array(profiles, np.float64)
    found = changes(known)
    most = max(found, key=lambda each: abs(each.after - each.before), default=None)
    at = most.since if most else len(known) // 2
    bins = known.shape[1]
    return {
        "s": [round((bin + 0.5) / bins, 6) for bin in range(bins)],
        "earlier": _medians(known[:at] if at else known),
        "later": _medians(known[at:]),
        "changes": [asdict(each) for each in found],
    }


def _medians(profiles: np.ndarray) -> list[float | None]:
    columns = [column[np.isfinite(column)] for column in profiles.T]
    return [round(float(np.median(each)), 6) if len(each) else None for each in columns]


def check_workspace(progress: Progress, *, workspace: str) -> Json:
    """What a learnt file holds: `workspace_id`, `facts`, `bytes`. Raises AppearanceError."""
    return _workspace(load_workspace(workspace), workspace)


def learn_workspace(
    progress: Progress,
    *,
    pictures: str,
    folder: str,
    periods: Mapping[str, float],
    workspace: str,
    max_bytes: int,
    max_files: int,
    max_pixels: int,
) -> Json:
    """Labelled pictures, in an archive or a recording, as a workspace: what `check_workspace` tells of it.

    Raises ArchiveRefused, RecordingError, LabelsRefused, LearningError, PictureError.
    """
    path = Path(pictures)
    with path.open("rb") as file:
        packed = file.read(len(BEGINS)) == BEGINS
    if packed:
        labels = read_archive(path, Path(folder), periods, max_bytes=max_bytes, max_files=max_files)
    else:
        labels = read_recording(path, periods)
    return _workspace(learn_labels(labels, workspace, progress, max_pixels=max_pixels), workspace)


def _workspace(learnt: Workspace, path: str) -> Json:
    facts = {
        "parameters": [{"name": each.name, "period": each.period} for each in learnt.parameters],
        "objects": list(learnt.objects),
        "pictures": int(learnt.facts["pictures"]),
    }
    return {"workspace_id": learnt.id, "facts": facts, "bytes": Path(path).stat().st_size}


TASKS: Mapping[str, Callable[..., Json]] = {
    "survey": survey,
    "record": record,
    "learn": learn,
    "excuse": excuse,
    "replay": replay,
    "recognise": recognise,
    "rejudge": rejudge,
    "picture": picture,
    "drift": drift,
    "sampling": sampling,
    "reference": reference,
    "check_workspace": check_workspace,
    "learn_workspace": learn_workspace,
    "ignored": ignored,
}
IN_PIECES: Mapping[str, Callable[..., Json]] = {"batch": batch}
"""Instead of progress these tell of each piece of work that is done."""
