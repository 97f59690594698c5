"""What every store promises; what can go wrong with one is in `errors`."""

from __future__ import annotations

from abc import abstractmethod
from types import TracebackType
from typing import Self

from inspector.stores.records import (
    AuditEntry,
    Claim,
    Decision,
    Disposition,
    Ended,
    InspectionSource,
    InspectionState,
    Job,
    JobKind,
    JobState,
    Json,
    Page,
    Product,
    Recipe,
    RecordingState,
    Role,
    StoredAppearance,
    StoredInspection,
    StoredRecording,
    StoredWorkspace,
    Sweep,
    Token,
)
from inspector.stores.shared import AbstractCheckpoints, AbstractNodes, AbstractTelling


class AbstractStore(AbstractNodes, AbstractCheckpoints, AbstractTelling):
    """Everything that the service remembers. A context manager: leaving it closes it.

    Every method is one transaction: done when it returns, not done at all when it raises; what was done survives a
    kill. Calls block, and may come from many threads. Lists are newest first; `after` is the `next` of the page before,
    `limit` the most that a page may hold. Every method raises StoreFailed where the database fails.
    """

    @property
    @abstractmethod
    def shared(self) -> bool:
        """Whether several services may work on it at once."""

    @classmethod
    @abstractmethod
    def open(cls, url: str) -> Self:
        """The store at the url. Raises StoreNotOpened, NewerStore, OlderServices."""

    # Products, sweeps, appearances.

    @abstractmethod
    def ensure_product(self, product_id: str, t_ns: int) -> Product:
        """The product; made at `t_ns`, where it was not there."""

    @abstractmethod
    def product(self, product_id: str) -> Product:
        """Raises NoSuchProduct."""

    @abstractmethod
    def products(self, after: int | None = None, limit: int = 50) -> Page[Product]:
        """All of them."""

    @abstractmethod
    def add_sweep(self, sweep: Sweep) -> None:
        """Its product comes into being with it. Raises IdTaken."""

    @abstractmethod
    def sweep(self, sweep_id: str) -> Sweep:
        """Raises NoSuchSweep."""

    @abstractmethod
    def sweeps(self, product_id: str, after: int | None = None, limit: int = 50) -> Page[Sweep]:
        """Those of a product. Raises NoSuchProduct."""

    @abstractmethod
    def add_appearance(self, appearance: StoredAppearance) -> StoredAppearance:
        """The appearance; the one that is there already, where the product has it. Raises NoSuchProduct."""

    @abstractmethod
    def appearance(self, product_id: str, appearance_id: str) -> StoredAppearance:
        """Raises NoSuchAppearance."""

    @abstractmethod
    def appearances(self, product_id: str, after: int | None = None, limit: int = 50) -> Page[StoredAppearance]:
        """Those of a product. Raises NoSuchProduct."""

    # Workspaces.

    @abstractmethod
    def add_workspace(self, workspace: StoredWorkspace) -> StoredWorkspace:
        """The workspace; the one that is there already, where there is one."""

    @abstractmethod
    def workspace(self, workspace_id: str) -> StoredWorkspace:
        """Raises NoSuchWorkspace."""

    @abstractmethod
    def workspaces(self, after: int | None = None, limit: int = 50) -> Page[StoredWorkspace]:
        """All of them."""

    # Jobs.

    @abstractmethod
    def add_job(
        self, job_id: str, kind: JobKind, product_id: str | None, request: Json, t_ns: int, *, node: str | None = None
    ) -> Job:
        """A running job; its product, where it is of one, comes into being with it. Raises IdTaken.

        `node` is the service that does it.
        """

    @abstractmethod
    def update_job(
        self,
        job_id: str,
        *,
        progress: float | None = None,
        state: JobState | None = None,
        ended_ns: int | None = None,
        outcome: Json | None = None,
        error: str | None = None,
    ) -> Job:
        """The job with what is given changed; a job that has ended changes no more. Raises NoSuchJob, JobEnded."""

    @abstractmethod
    def job(self, job_id: str) -> Job:
        """Raises NoSuchJob."""

    @abstractmethod
    def jobs(
        self,
        *,
        product_id: str | None = None,
        state: JobState | None = None,
        after: int | None = None,
        limit: int = 50,
    ) -> Page[Job]:
        """All of them, or those of a product, or in a state."""

    @abstractmethod
    def fail_running_jobs(self, t_ns: int, why: str) -> tuple[str, ...]:
        """At start, after a crash: the ids of the jobs that ran, which have failed now."""

    # Recipes.

    @abstractmethod
    def add_recipe(
        self,
        recipe_id: str,
        product_id: str,
        appearance_id: str,
        policy: Json,
        *,
        note: str = "",
        activate: bool = True,
        actor: str,
        t_ns: int,
    ) -> Recipe:
        """A new version, and `recipe.add` in the audit trail: before is the active recipe, after the new one.

        Raises IdTaken, NoSuchProduct, NoSuchAppearance.
        """

    @abstractmethod
    def activate_recipe(self, product_id: str, recipe_id: str, *, actor: str, t_ns: int) -> Recipe:
        """The recipe, active instead of the one that was, with an entry in the audit trail unless it was active.

        Raises NoSuchProduct, NoSuchRecipe.
        """

    @abstractmethod
    def recipe(self, recipe_id: str) -> Recipe:
        """Raises NoSuchRecipe."""

    @abstractmethod
    def recipes(self, product_id: str, after: int | None = None, limit: int = 50) -> Page[Recipe]:
        """Those of a product. Raises NoSuchProduct."""

    @abstractmethod
    def active_recipe(self, product_id: str) -> Recipe | None:
        """None where no recipe is active. Raises NoSuchProduct."""

    # Inspections.

    @abstractmethod
    def begin_inspection(
        self,
        inspection_id: str,
        product_id: str,
        *,
        part_id: str | None,
        recipe_id: str | None,
        appearance_id: str,
        policy: Json,
        begun_ns: int,
        source: InspectionSource = "live",
        is_simulated: bool = False,
        recording: RecordingState = "being written",
        node: str | None = None,
    ) -> StoredInspection:
        """An inspection in processing, which that service has.

        Raises IdTaken, NoSuchProduct, NoSuchRecipe, NoSuchAppearance.
        """

    @abstractmethod
    def conclude_inspection(
        self,
        inspection_id: str,
        state: Ended,
        *,
        verdict: str | None,
        ended_ns: int,
        result: Json | None,
        scores: bytes | None,
        reason: str | None = None,
        node: str | None = None,
    ) -> StoredInspection:
        """The inspection, ended; its scores, which come with a result, are kept as they are, its checkpoints go.

        Raises NoSuchInspection, AlreadyConcluded, and NotOwner unless `node` has it; None where no service has it.
        """

    @abstractmethod
    def acknowledge_inspection(self, inspection_id: str, t_ns: int) -> StoredInspection:
        """The first time counts, and further ones do nothing. Raises NoSuchInspection, NotEnded."""

    @abstractmethod
    def dispose(
        self, inspection_id: str, decision: Decision, verdict: str | None, *, comment: str = "", actor: str, t_ns: int
    ) -> StoredInspection:
        """What a person says of it, beside the verdict; the last word counts, all are kept and in the audit trail.

        `verdict` is what they say instead, where they overrule. Raises NoSuchInspection, NotEnded, NothingToDecide.
        """

    @abstractmethod
    def dispositions(self, inspection_id: str, after: int | None = None, limit: int = 50) -> Page[Disposition]:
        """All that was said of it. Raises NoSuchInspection."""

    @abstractmethod
    def inspection(self, inspection_id: str) -> StoredInspection:
        """Raises NoSuchInspection."""

    @abstractmethod
    def inspections(
        self,
        *,
        product_id: str | None = None,
        verdict: str | None = None,
        state: InspectionState | None = None,
        source: InspectionSource | None = None,
        part: str | None = None,
        after: int | None = None,
        limit: int = 50,
    ) -> Page[StoredInspection]:
        """All of them, or those that have what is given; `part` is how `part_id` begins, `after` a number."""

    @abstractmethod
    def scores(self, inspection_id: str) -> bytes | None:
        """As handed to `conclude_inspection`; None where there are none, or none any more. Raises NoSuchInspection."""

    @abstractmethod
    def remove_scores(self, before_ns: int, limit: int, t_ns: int) -> int:
        """Of inspections that ended before that time, the first that ended and so many at the most, the scores go.

        Everything else stays, and says since when they are gone: `t_ns`. How many inspections it was; fewer than
        `limit` where there are no more. What it costs does not depend on how many there are.
        """

    @abstractmethod
    def abort_processing(self, t_ns: int, why: str) -> tuple[str, ...]:
        """At start, after a crash: the ids of the inspections in processing, which are aborted now."""

    # Recordings of inspections.

    @abstractmethod
    def set_recording(
        self, inspection_id: str, recording: RecordingState, bytes: int = 0, note: str | None = None
    ) -> StoredInspection:
        """The inspection, with what became of its recording. Raises NoSuchInspection."""

    @abstractmethod
    def recordings(
        self, recording: RecordingState = "kept", after: int | None = None, limit: int | None = None
    ) -> tuple[StoredRecording, ...]:
        """Those in that state, the oldest inspection first; all, or so many whose number is above `after`."""

    # Audit trail, tokens.

    @abstractmethod
    def add_audit(
        self, *, t_ns: int, actor: str, action: str, thing: str, before: Json | None = None, after: Json | None = None
    ) -> AuditEntry:
        """One more entry; there is no way to change or remove one, and the database refuses it, too."""

    @abstractmethod
    def audit(self, after: int | None = None, limit: int = 50) -> Page[AuditEntry]:
        """All entries; `after` is a number."""

    @abstractmethod
    def add_token(self, token_id: str, name: str, role: Role, sha256: str, *, actor: str, t_ns: int) -> Token:
        """With an entry in the audit trail. Raises IdTaken, for the id and for the hash."""

    @abstractmethod
    def revoke_token(self, token_id: str, *, actor: str, t_ns: int) -> Token:
        """With an entry in the audit trail; the first time counts. Raises NoSuchToken."""

    @abstractmethod
    def tokens(self) -> tuple[Token, ...]:
        """All of them, those revoked, too."""

    @abstractmethod
    def token_by_hash(self, sha256: str) -> Token | None:
        """None where no token has that hash; one that was revoked says so itself."""

    # Requests that may come twice.

    @abstractmethod
    def claim(self, scope: str, key: str, fingerprint: str, t_ns: int, *, node: str | None = None) -> Claim:
        """Of many that claim a key at once, one gets `new`: it does the work, then settles or releases.

        `node` is the service that it asks.
        """

    @abstractmethod
    def settle(self, scope: str, key: str, status: int, body: bytes, *, node: str | None = None) -> None:
        """The answer that further claims get. What is settled stays.

        Nothing is done where the claim is not that service's any more, as here and with `release`: it was taken for
        gone, and another one may be at the work.
        """

    @abstractmethod
    def release(self, scope: str, key: str, *, node: str | None = None) -> None:
        """The work was not done: the next claim is new. What is settled stays."""

    @abstractmethod
    def release_pending_claims(self) -> int:
        """At start, after a crash: how many were released."""

    @abstractmethod
    def forget_claims(self, before_ns: int) -> int:
        """How many settled claims, made before that time, were forgotten."""

    # The store itself.

    @abstractmethod
    def ping(self) -> None:
        """Return where the database answers. Raises StoreFailed."""

    @abstractmethod
    def close(self) -> None:
        """Let the database go; a second call does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
