"""Learning for the service: the same appearance as `inspector learn` makes of the same sweeps, in the same order."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from inspector.files import write_new
from inspector.locations import shown_place
from inspector.service.desk import Desk, naming
from inspector.service.files import Files
from inspector.service.folder import remove
from inspector.stores.base import AbstractStore
from inspector.stores.errors import NoSuchSweep
from inspector.stores.records import Json, StoredAppearance


class Learning:
    """Learns appearances of products. Everything here blocks."""

    def __init__(
        self,
        store: AbstractStore,
        files: Files,
        desk: Desk,
        now_ns: Callable[[], int] = time.time_ns,
        *,
        executor: str = "serial",
    ) -> None:
        self._store, self._files, self._desk, self._now_ns = store, files, desk, now_ns
        self._executor = executor

    def check(self, product_id: str, sweep_ids: Sequence[str], add_to: str | None) -> None:
        """Raises NoSuchProduct, NoSuchSweep, NoSuchAppearance, before a job is begun."""
        self._store.product(product_id)
        for sweep_id in sweep_ids:
            if self._store.sweep(sweep_id).product_id != product_id:
                raise NoSuchSweep(sweep_id)
        if add_to is not None:
            self._store.appearance(product_id, add_to)

    def learn(
        self,
        progress: Callable[[float], object],
        product_id: str,
        sweep_ids: Sequence[str],
        add_to: str | None,
        ignore: bytes | None = None,
    ) -> Json:
        """An appearance, as the outcome of a job. Raises WorkFailed, with the ids of sweeps, and NotWritten.

        `ignore` is a don't-care mask, the bytes of a PNG.
        """
        sweeps = [self._files.place("sweep", sweep_id) for sweep_id in sweep_ids]
        names = {shown_place(place): f"sweep {sweep_id}" for place, sweep_id in zip(sweeps, sweep_ids, strict=True)}
        before: tuple[str, ...] = ()
        asked: Json = {"sweeps": sweeps, "add_to": None, "ignore": None, "executor": self._executor}
        if add_to is not None:
            old = self._files.local_appearance(add_to)
            before = self._store.appearance(product_id, add_to).sweep_ids
            asked["add_to"], names[str(old)] = str(old), f"appearance {add_to}"
        with self._mask(ignore) as mask:
            if mask is not None:
                asked["ignore"], names[str(mask)] = str(mask), "the mask"
            return self._made("learn", asked, names, progress, product_id=product_id, sweep_ids=(*before, *sweep_ids))

    def excuse(
        self, progress: Callable[[float], object], product_id: str, of: str, regions: Sequence[Mapping[str, float]]
    ) -> Json:
        """An appearance that tolerates everything in regions of the part, as the outcome of a job.

        A region has `s`, and `x`, `y`, `width`, `height` on the reference picture there. Raises WorkFailed, NotWritten.
        """
        sweep_ids, old = self._store.appearance(product_id, of).sweep_ids, str(self._files.local_appearance(of))
        asked: Json = {"of": old, "regions": regions}
        return self._made(
            "excuse", asked, {old: f"appearance {of}"}, progress, product_id=product_id, sweep_ids=sweep_ids
        )

    @contextmanager
    def _mask(self, ignore: bytes | None) -> Generator[Path | None]:
        """The mask as a file, for as long as it is needed."""
        path = self._files.incoming()
        try:
            if ignore is not None:
                write_new(path, ignore)
            yield path if ignore is not None else None
        finally:
            remove(path)

    def _made(
        self,
        task: str,
        asked: Json,
        names: Mapping[str, str],
        progress: Callable[[float], object],
        *,
        product_id: str,
        sweep_ids: tuple[str, ...],
    ) -> Json:
        draft = self._files.incoming()
        try:
            with naming({**names, str(draft): "the appearance"}) as named:
                made = self._desk.do(task, {**asked, "appearance": str(draft)}, progress)
                said = tuple(named(each) for each in made["said"])
            self._keep(draft, made["appearance_id"])
        finally:
            remove(draft)
        stored = StoredAppearance(
            made["appearance_id"], product_id, self._now_ns(), sweep_ids, made["facts"], said, made["bytes"]
        )
        self._store.add_appearance(stored)
        return {"appearance_id": stored.appearance_id, "said": list(said)}

    def _keep(self, draft: Path, appearance_id: str) -> None:
        # The name is the hash of what is in it: what is there already is the same.
        if self._files.size("appearance", appearance_id) is None:
            self._files.publish(draft, "appearance", appearance_id)
