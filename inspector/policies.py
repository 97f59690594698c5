"""Policy files: JSON with the names of `models.verdict.Policy`, checked when read; errors say what was allowed.

inspector.errors.WorldError
└── PolicyRefused            a policy file that cannot be read, or that says what is not allowed
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inspector.errors import WorldError
from inspector.locations import Location
from models.verdict import ALLOWED, Policy

Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


class PolicyRefused(WorldError):
    """A policy file that cannot be read, or that says what is not allowed."""

    def __init__(self, path: Location, why: str) -> None:
        super().__init__(f"{path}: {why}")


class PolicyFile(BaseModel):
    """What may be asked for; every field may be left out. The meaning of each is told in `models.verdict.Policy`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    false_rejects: Annotated[float, Field(ge=ALLOWED["false_rejects"][0], le=ALLOWED["false_rejects"][1])] = (
        Policy.false_rejects
    )
    sensitivity: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)] = Policy.sensitivity
    review_margin: Share = Policy.review_margin
    hysteresis: Share = Policy.hysteresis
    coverage: Share = Policy.coverage
    invalid_share: Share = Policy.invalid_share


def read_policy(path: Location) -> Policy:
    """The policy in a file. Raises ObjectError; PolicyRefused, with the first field, its value, and what is allowed."""
    try:
        return Policy(**PolicyFile.model_validate_json(path.read_bytes()).model_dump())
    except OSError as error:
        raise PolicyRefused(path, error.strerror or str(error)) from error
    except ValidationError as error:
        raise PolicyRefused(path, _sentence(error)) from error


def _sentence(error: ValidationError) -> str:
    wrong = error.errors()[0]
    name = ".".join(str(part) for part in wrong["loc"])
    if wrong["type"] == "extra_forbidden":
        return f"{name} is not a field of a policy; known are {', '.join(PolicyFile.model_fields)}"
    if not name:
        return f"no policy: {wrong['msg'][0].lower()}{wrong['msg'][1:]}; allowed is a JSON object"
    return f"{name} is {wrong['input']!r}; {wrong['msg'].replace('Input should', 'it should')}"
