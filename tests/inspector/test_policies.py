"""Policy files say what they mean, or are refused with the field, its value and what is allowed."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pytest

from inspector.policies import PolicyFile, PolicyRefused, read_policy
from models.verdict import Policy


def test_what_is_left_out_is_as_usual(tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    path.write_text("{}")
    assert read_policy(path) == Policy()
    path.write_text('{"sensitivity": 2, "coverage": 0.5}')
    assert read_policy(path) == Policy(sensitivity=2.0, coverage=0.5)


def test_every_field_of_a_policy_can_be_asked_for_and_has_its_usual_value() -> None:
    assert PolicyFile().model_dump() == asdict(Policy())


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"coverage": 1.5}', "coverage is 1.5; it should be less than or equal to 1"),
        ('{"false_rejects": 0.6}', "false_rejects is 0.6; it should be less than or equal to 0.5"),
        ('{"false_rejects": 0}', "false_rejects is 0; it should be greater than or equal to 0.0001"),
        ('{"sensitivity": 0}', "sensitivity is 0; it should be greater than 0"),
        ('{"hysteresis": "much"}', "hysteresis is 'much'; it should be a valid number"),
        ('{"hysteresis": NaN}', "hysteresis is nan; it should be"),
        (
            '{"sensivity": 1}',
            "sensivity is not a field of a policy; known are false_rejects, sensitivity, review_margin",
        ),
        ("[1]", "no policy: "),
        ("{", "no policy: invalid JSON"),
        (None, "No such file"),
    ],
)
def test_what_is_not_allowed_is_refused_in_a_line(tmp_path: Path, content: str | None, said: str) -> None:
    path = tmp_path / "p.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(PolicyRefused) as caught:
        read_policy(path)
    assert str(caught.value).startswith(f"{path}: {said}")
    assert "\n" not in str(caught.value)
