"""Golden recordings -> an appearance on the disk: whole or not at all, and no loss in a recording goes untold."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from inspector.files import refuse_taken, write_new
from inspector.recording import SweepReader, count_frames
from models.appearance import Appearance
from models.errors import AppearanceError, NumericError
from models.frame import Frame
from models.learning import learn


class _Golden:
    """A recording that says when it is being read, and each loss once."""

    def __init__(self, path: Path, topic: str | None, tell: Callable[[str], object]) -> None:
        self.reader = SweepReader(path, topic=topic)
        self.open = False
        self._tell, self._told = tell, set[str]()

    def __iter__(self) -> Iterator[Frame]:
        self.open = True
        yield from self.reader
        self.open = False
        for loss in self.reader.losses:
            if loss not in self._told:
                self._told.add(loss)
                self._tell(f"{self.reader.path}: {loss}")


def learn_recordings(
    paths: Sequence[Path | str],
    out: Path | str,
    progress: Callable[[float], None] | None = None,
    *,
    topic: str | None = None,
    tell: Callable[[str], object] = lambda loss: None,
) -> Appearance:
    """Learn from golden recordings, the first as reference, and write the appearance to the new file `out`.

    `progress` is called with the share done, `tell` with a sentence for each thing that a recording has lost. Raises
    RecordingError, OutputExists, NotWritten; LearningError and PictureError name the recording.
    """
    out = Path(out)
    refuse_taken(out)
    goldens = [_Golden(Path(path), topic, tell) for path in paths]
    try:
        appearance = learn(goldens, progress, _announced(goldens))
    except NumericError as error:
        reading = [golden for golden in goldens if golden.open] or goldens
        raise type(error)(f"{', '.join(str(golden.reader.path) for golden in reading)}: {error}") from error
    write_new(out, appearance.to_bytes())
    return appearance


def _announced(goldens: Sequence[_Golden]) -> int | None:
    """How many frames there will be, where every recording says it."""
    counts = [count_frames(golden.reader.path) for golden in goldens]
    known = [count for count in counts if count is not None]
    return sum(known) if len(known) == len(counts) else None


def load_appearance(path: Path | str) -> Appearance:
    """The appearance in a file. Raises AppearanceError, which names the file, whatever is wrong with it."""
    try:
        return Appearance.from_bytes(Path(path).read_bytes())
    except OSError as error:
        raise AppearanceError(f"{path}: {error.strerror or error}; allowed is a file that `learn` wrote") from error
    except AppearanceError as error:
        raise AppearanceError(f"{path}: {error}") from error
