"""What the store holds: one frozen record per noun. Times are nanoseconds since the epoch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

JobKind = Literal["learn", "record", "replay", "batch", "workspace"]
JobState = Literal["running", "done", "failed"]
InspectionState = Literal["processing", "completed", "aborted", "failed"]
Ended = Literal["completed", "aborted", "failed"]
InspectionSource = Literal["live", "replay"]
SweepSource = Literal["upload", "camera"]
WorkspaceSource = Literal["upload", "pictures"]
RecordingState = Literal["being written", "kept", "none", "removed"]
ScoresState = Literal["being written", "kept", "none", "removed"]
Decision = Literal["confirm", "overrule"]
Role = Literal["viewer", "operator", "engineer", "admin"]
Json = dict[str, Any]
"""A JSON object; no NaN, no infinity."""

T = TypeVar("T")


@dataclass(frozen=True)
class Page(Generic[T]):
    """Part of a list, newest first."""

    items: tuple[T, ...]
    next: int | None
    """Hand it in as `after` for what comes after these; None where nothing does."""


@dataclass(frozen=True)
class Product:
    """What is inspected: all parts that ought to look alike."""

    product_id: str
    created_ns: int


@dataclass(frozen=True)
class Sweep:
    """A recording that came by upload or from a camera of the service."""

    sweep_id: str
    product_id: str
    part_id: str | None
    created_ns: int
    frames: int
    bytes: int
    sha256: str
    source: SweepSource
    losses: tuple[str, ...] = ()
    """A sentence for each thing that could not be read."""


@dataclass(frozen=True)
class StoredAppearance:
    """What was learnt of a product; the file is named by the id."""

    appearance_id: str
    product_id: str
    created_ns: int
    sweep_ids: tuple[str, ...]
    facts: Json
    said: tuple[str, ...]
    """Warnings of learning."""
    bytes: int


@dataclass(frozen=True)
class StoredWorkspace:
    """Where objects are, learnt from pictures; the file is named by the id."""

    workspace_id: str
    name: str | None
    """What people call it."""
    created_ns: int
    source: WorkspaceSource
    """`upload`: it came learnt; `pictures`: it was learnt here."""
    facts: Json
    """`parameters`, `objects`, `pictures`."""
    bytes: int


@dataclass(frozen=True)
class Job:
    """Long work, and how far it is."""

    job_id: str
    kind: JobKind
    product_id: str | None
    """None where it is of no product: a workspace."""
    state: JobState
    progress: float
    """From 0 to 1."""
    created_ns: int
    ended_ns: int | None
    request: Json
    outcome: Json | None
    """What came of it, where it is done."""
    error: str | None
    """A sentence, where it failed."""


@dataclass(frozen=True)
class Recipe:
    """How a product is judged: an appearance and a policy. A version never changes; an edit is a new version."""

    recipe_id: str
    product_id: str
    version: int
    """Counts the product's recipes from 1."""
    appearance_id: str
    policy: Json
    active: bool
    """One recipe of a product is active, or none."""
    created_ns: int
    created_by: str
    note: str


@dataclass(frozen=True)
class StoredInspection:
    """One part inspected, live or once more from its recording; its scores are kept beside it."""

    inspection_id: str
    number: int
    """Increases with every inspection begun; the cursor of lists."""
    product_id: str
    part_id: str | None
    recipe_id: str | None
    appearance_id: str
    policy: Json
    """The policy that it was begun with."""
    state: InspectionState
    verdict: str | None
    is_simulated: bool
    source: InspectionSource
    begun_ns: int
    ended_ns: int | None
    acknowledged_ns: int | None
    result: Json | None
    """The result without frames."""
    reason: str | None
    """Why it was aborted, or failed."""
    ok_number: int | None
    """A live OK is the so-manieth of its product, counted from 1 in the order of conclusion; None for all others."""
    recording: RecordingState
    recording_bytes: int
    recording_note: str | None
    """Why there is no recording any more, or what it lacks."""
    disposition: Json | None = None
    """What a person said of it last: `decision`, `verdict`, `comment`, `actor`, `t_ns`."""
    node: str | None = None
    """The service that has it, or had it last, where it has ended; in processing and None: no service has it."""
    left_ns: int | None = None
    """Since when no service has it."""
    takes: int = 0
    """How often a service took it over."""
    scores_removed_ns: int | None = None
    """Since when the scores of its frames are not kept any more."""

    @property
    def scores(self) -> ScoresState:
        """What became of the scores of its frames: they come with a result."""
        if self.state == "processing":
            return "being written"
        if self.result is None:
            return "none"
        return "kept" if self.scores_removed_ns is None else "removed"


@dataclass(frozen=True)
class Checkpoint:
    """How far an inspection is, for the service that takes it over."""

    state: bytes
    """As handed in last; empty where a crash of the database has lost it: it is not logged."""
    added: tuple[bytes, ...]
    """All that was handed in, in its order."""


@dataclass(frozen=True)
class Node:
    """A service that works on the store."""

    node_id: str
    """New at every start."""
    name: str
    """What people call it."""
    started_ns: int
    silent_seconds: float
    """Since it said that it lives, by the clock of the database."""
    facts: Json
    """What it said of itself."""


@dataclass(frozen=True)
class Buried:
    """What was found of services that are gone."""

    nodes: tuple[Node, ...]
    job_ids: tuple[str, ...]
    """They have failed."""
    inspection_ids: tuple[str, ...]
    """No service has them now."""


@dataclass(frozen=True)
class Disposition:
    """What a person said of an inspection that has ended. The verdict stays as it was given."""

    number: int
    """Increases; the cursor of lists."""
    inspection_id: str
    decision: Decision
    verdict: str
    """What holds for that person: the verdict that was given, or the other one."""
    comment: str
    actor: str
    t_ns: int


@dataclass(frozen=True)
class StoredRecording:
    """What is to be known of the recording of an inspection, to decide whether it stays."""

    inspection_id: str
    number: int
    product_id: str
    state: InspectionState
    verdict: str | None
    source: InspectionSource
    ended_ns: int | None
    ok_number: int | None
    bytes: int


@dataclass(frozen=True)
class AuditEntry:
    """Who changed what, when: never changed, never removed."""

    number: int
    """Increases; the cursor of lists."""
    t_ns: int
    actor: str
    action: str
    """`recipe.add`, `recipe.activate`, `inspection.dispose`, `token.add`, `token.revoke`."""
    thing: str
    """The id of what was changed."""
    before: Json | None
    after: Json | None


@dataclass(frozen=True)
class Token:
    """Who may ask, and what. The token itself is not kept."""

    token_id: str
    name: str
    role: Role
    sha256: str
    """Of the token, in hexadecimal digits."""
    created_ns: int
    revoked_ns: int | None


@dataclass(frozen=True)
class Claim:
    """What is known of a request that may come twice."""

    state: Literal["new", "pending", "settled", "other"]
    """`new`: do it, then settle or release. `pending`: being done. `settled`: done. `other`: another request's key."""
    status: int | None = None
    """The HTTP status of the answer, where it is settled."""
    body: bytes | None = None
    """The body of the answer, where it is settled."""
