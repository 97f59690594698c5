"""Workspaces on the disk: labels that can be used and cannot, and what `locate` says in words and as JSON."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inspector.cli import run
from inspector.labels import LabelsRefused, read_csv, read_labels
from inspector.pictures import encode_png
from inspector.workspaces import learn_labels, load_workspace, locate_picture
from models.errors import AppearanceError, LearningError, PictureError
from models.workspace import Parameter
from tests.inspector.conftest import Line
from tests.models.parts import surface
from tests.models.workspace.drawn import VIEW, view

Captured = pytest.CaptureFixture[str]
X = (-6.0, -3.0, 0.0, 3.0, 6.0)


def told(capsys: Captured, *arguments: object) -> tuple[int, str, str]:
    """Exit code, stdout, stderr."""
    code = run([str(argument) for argument in arguments])
    return code, *capsys.readouterr()


def labelled(folder: Path, parts: tuple[int, ...] = (1, 2), head: str = "file,object,x") -> Path:
    """A list of pictures of parts over x, the pictures beside it."""
    rows = [head]
    for part in parts:
        for x in X:
            name = f"{part}_{x:g}.png"
            (folder / name).write_bytes(encode_png(view(surface(part), x)).data)
            rows.append(f"{name},part{part},{x}")
    (folder / "labels.csv").write_text("\n".join(rows) + "\n")
    return folder / "labels.csv"


@pytest.fixture(scope="module")
def learnt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("workspace")
    learn_labels(read_labels(labelled(folder)), folder / "parts.workspace")
    return folder / "parts.workspace"


def test_learning_and_locating_by_command(tmp_path: Path, capsys: Captured) -> None:
    labels, out, result = labelled(tmp_path), tmp_path / "w.workspace", tmp_path / "located.json"
    code, said, err = told(capsys, "workspace", "learn", labels, "--out", out)
    assert (code, err) == (0, "")
    assert said.splitlines() == [f"{out}: 2 objects over x, from 10 pictures", load_workspace(out).id]
    for name, part, x in (("a.png", 1, 1.4), ("b.png", 2, -4.6), ("c.png", 3, 0.0)):
        (tmp_path / name).write_bytes(encode_png(view(surface(part), x)).data)
    seen = [tmp_path / name for name in ("a.png", "b.png", "c.png")]
    code, said, err = told(capsys, "locate", *seen, "--workspace", out, "--json", result)
    assert (code, err) == (0, "")
    first, second, third = said.splitlines()
    assert first.startswith(f"{seen[0]}: part1, x 1.")
    assert second.startswith(f"{seen[1]}: part2, x -4.")
    assert third.startswith(f"{seen[2]}: none of the objects, distance 0.")
    records: list[dict[str, Any]] = json.loads(result.read_text())
    assert [record["file"] for record in records] == list(map(str, seen))
    assert [(record["object"], record["state"]) for record in records] == [
        ("part1", "known"),
        ("part2", "known"),
        (None, "unknown"),
    ]
    assert records[0]["q"] == pytest.approx({"x": 1.4}, abs=0.15)
    assert set(records[0]["uncertainty"]) == {"x"}
    assert (records[2]["q"], records[2]["uncertainty"]) == (None, None)
    assert records[2]["others"][0]["distance"] == records[2]["distance"]


def test_columns_come_in_any_order_and_axes_may_turn(tmp_path: Path) -> None:
    (tmp_path / "l.csv").write_text("\ufeffangle_deg, object,file\n10,cup,a.png\n\n20,cup,sub/b.png\n")
    labels = read_csv(tmp_path / "l.csv", {"angle_deg": 360})
    assert labels.parameters == (Parameter("angle_deg", 360),)
    assert labels.rows == ((tmp_path / "a.png", "cup", (10.0,)), (tmp_path / "sub/b.png", "cup", (20.0,)))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "its columns are none; needed are file, object, and one per parameter"),
        ("file,object\na.png,cup\n", "its columns are file, object; needed"),
        ("file,object,x,x\n", "its columns are file, object, x, x; needed"),
        ("file,object,x\n", "no row below its head"),
        ("file,object,x\na.png,cup\n", "row 2 has 2 columns, its head has 3"),
        ("file,object,x\na.png,cup,far\n", "row 2: x is 'far'; allowed is a number"),
        ("file,object,x\na.png,cup,inf\n", "row 2: x is 'inf'; allowed is a number"),
        ("file,object,x\n,cup,1\n", "row 2: no file"),
        ("\x00\xff", "labels.csv: "),
    ],
)
def test_labels_that_cannot_be_used_are_refused_in_a_line(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "labels.csv").write_text(text)
    with pytest.raises(LabelsRefused) as error:
        read_labels(tmp_path / "labels.csv")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_period_of_nothing_is_refused(tmp_path: Path, capsys: Captured) -> None:
    labels = labelled(tmp_path)
    code, _, err = told(capsys, "workspace", "learn", labels, "--out", tmp_path / "w", "--periodic", "angle=360")
    assert (code, err.count("\n")) == (1, 1)
    assert "no parameter angle, of which a period was given; parameters are x" in err
    code, _, err = told(capsys, "workspace", "learn", labels, "--out", tmp_path / "w", "--periodic", "x=-1")
    assert (code, err.count("\n")) == (2, 1)
    assert not (tmp_path / "w").exists()


def test_what_is_wrong_with_a_picture_names_it(tmp_path: Path, learnt: Path) -> None:
    labels = labelled(tmp_path)
    (tmp_path / "1_0.png").write_bytes(b"no picture")
    with pytest.raises(PictureError, match=r"1_0\.png: "):
        learn_labels(read_labels(labels), tmp_path / "w")
    (tmp_path / "1_0.png").unlink()
    with pytest.raises(PictureError, match=r"1_0\.png: No such file"):
        learn_labels(read_labels(labels), tmp_path / "w")
    (tmp_path / "small.png").write_bytes(encode_png(np.zeros((9, 9), np.uint8)).data)
    with pytest.raises(PictureError, match=rf"small\.png: picture is 9x9, learnt were pictures of {VIEW[0]}x{VIEW[1]}"):
        locate_picture(tmp_path / "small.png", load_workspace(learnt))


def test_a_place_without_a_picture_is_named(tmp_path: Path) -> None:
    labels = labelled(tmp_path, head="file,object,x")
    rows = labels.read_text().splitlines()
    labels.write_text("\n".join([rows[0] + ",y", *(row + ",0" for row in rows[1:]), "2_0.png,part2,0,1"]))
    with pytest.raises(LearningError, match="object part1: y is 0 everywhere; needed are two values or more"):
        learn_labels(read_labels(labels), tmp_path / "w")


def test_a_file_that_is_no_workspace_is_refused(tmp_path: Path) -> None:
    (tmp_path / "w").write_bytes(b"sweep-appearance")
    for name, said in (("w", "not a workspace"), ("none", "No such file")):
        with pytest.raises(AppearanceError, match=said):
            load_workspace(tmp_path / name)


def recorded(path: Path, said: Callable[[float], object]) -> Path:
    """A part seen from X, each picture with what is said of it; one more picture of which nothing is said."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        image = writer.register_schema("foxglove.CompressedImage", "jsonschema", b"{}")
        pictures = writer.register_channel("/camera/image", "json", image)
        labels = writer.register_channel("/workspace/q", "json", 0)
        for number, x in enumerate((*X, 99.0)):
            data = base64.b64encode(encode_png(view(surface(1), x)).data).decode()
            message = {"timestamp": {"sec": 0, "nsec": 0}, "frame_id": "", "format": "png", "data": data}
            writer.add_message(pictures, number, json.dumps(message).encode(), number, number)
            if x < 99:
                writer.add_message(labels, number, json.dumps(said(x)).encode(), number, number)
        writer.finish()
    return path


def test_a_recording_may_say_what_it_shows(tmp_path: Path, capsys: Captured) -> None:
    path = recorded(tmp_path / "part.mcap", lambda x: {"object": "part", "q": {"x": x}})
    code, said, err = told(capsys, "workspace", "learn", path, "--out", tmp_path / "w")
    assert (code, err) == (0, "")
    assert f"one object over x, from {len(X)} pictures" in said
    assert load_workspace(tmp_path / "w").locate(view(surface(1), 1.4)).q == pytest.approx((1.4,), abs=0.15)


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ({"object": "part"}, 'allowed is {"object": "cup", "q": {"angle_deg": 10.0}}'),
        ([], "allowed is"),
        ({"object": "part", "q": {"x": "far"}}, "allowed is"),
        ({"object": "part", "q": {"x": float("inf")}}, "allowed are numbers for x"),
    ],
)
def test_what_a_recording_says_amiss_is_refused(tmp_path: Path, message: object, said: str) -> None:
    path = recorded(tmp_path / "part.mcap", lambda x: message)
    with pytest.raises(LabelsRefused) as error:
        read_labels(path)
    assert said in str(error.value)


def test_a_recording_without_labels_is_refused(line: Line) -> None:
    with pytest.raises(LabelsRefused, match="nothing on /workspace/q"):
        read_labels(line.golden[0])


def test_a_folder_may_hold_its_labels(tmp_path: Path) -> None:
    assert read_labels(labelled(tmp_path).parent) == read_labels(tmp_path / "labels.csv")
