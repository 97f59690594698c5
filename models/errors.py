"""What can go wrong when learning, loading or scoring; every class writes its own sentence.

InspectionError                  root of everything this project raises on purpose
├── NumericError                 what `models` raises
│   ├── PictureError             a picture that cannot be used: size, type, content
│   ├── LearningError            golden sweeps that cannot be learnt from
│   │   └── SweepsDiffer         golden sweeps some of which must be wrong
│   ├── AppearanceError          a learnt file that cannot be trusted
│   ├── CheckpointError          a kept inspection that cannot be gone on with
│   └── PolicyError              a threshold outside of what it may be
└── WorldError                   what `inspector` raises (inspector/errors.py)
"""


class InspectionError(Exception):
    """Root: one sentence that names the thing, the value and what was allowed."""


class NumericError(InspectionError):
    """Raised by `models`: the numbers cannot be used."""


class PictureError(NumericError):
    """A picture that cannot be used: its size, type or content."""


class LearningError(NumericError):
    """Golden sweeps that nothing can be learnt from."""


class SweepsDiffer(LearningError):
    """Golden sweeps that differ by so much that some must be wrong, and nobody can tell which."""


class AppearanceError(NumericError):
    """A learnt file that is damaged, foreign or newer than this program."""


class CheckpointError(NumericError):
    """A kept inspection that is damaged, of another part, or newer than this program."""


class PolicyError(NumericError):
    """A threshold outside of what it may be."""
