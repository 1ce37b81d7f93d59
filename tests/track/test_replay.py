from __future__ import annotations

import math
import re
import stat
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.errors import MissingFileError, SessionError, StorageError
from limen.track.replay import read_session, session_text, write_session
from limen.track.session import Session, Track

HEADER = '# limen session 1: {"name": "s", "display": "d", "rate_hz": 30}\n'
COLUMNS = "time_s,viewer,x_m,y_m,z_m,direction_x,direction_y,direction_z\n"
ROW = "0.0,v1,1,2,3,0,0,-1\n"
ROLES, ROLE = COLUMNS.replace("viewer,", "viewer,role,"), ROW.replace("v1,", "v1,viewer,")
DOCS = Path(__file__).parents[2] / "docs" / "guide" / "sessions.md"

numbers = st.floats(-50, 50)
vectors = st.tuples(numbers, numbers, numbers)
directions = vectors.filter(lambda v: math.hypot(*v) > 1e-3)
names = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"], exclude_characters="#"), max_size=5)


@st.composite
def sessions(draw: st.DrawFn) -> Session:
    tracks = []
    for name in draw(st.lists(names, min_size=1, max_size=3, unique=True)):
        count = draw(st.integers(1, 5))
        times = np.cumsum(draw(st.lists(st.floats(1e-3, 9), min_size=count, max_size=count)))
        position = np.array(draw(st.lists(vectors, min_size=count, max_size=count)))
        direction = np.array(
            draw(st.lists(vectors.filter(lambda v: math.hypot(*v) > 1e-3), min_size=count, max_size=count))
        )
        known = draw(st.lists(st.booleans(), min_size=count, max_size=count))
        gaze = np.where(np.array(known)[:, None], direction, math.nan) if any(known) else None
        acuity = np.where(known, 0.5, math.nan) if any(known) and draw(st.booleans()) else None
        tracks.append(Track(name, times, position, direction, gaze, acuity))
    pointers, of = draw(st.lists(names, max_size=2, unique=True)), tracks[0]
    held = tuple(Track(name, of.time_s, of.direction, of.direction) for name in pointers)
    return Session(draw(names.filter(bool)), draw(names), draw(st.floats(0.1, 1000)), tuple(tracks), held)


def same(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    if a is None or b is None:
        return a is b
    return np.array_equal(a, b, equal_nan=True)


@settings(max_examples=60, deadline=None)
@given(session=sessions())
def test_what_is_written_is_read_back_exactly(session: Session, tmp_path_factory: pytest.TempPathFactory):
    path = tmp_path_factory.mktemp("session") / "s.csv"
    write_session(path, session)
    again = read_session(path)
    assert (again.name, again.display, again.rate_hz) == (session.name, session.display, session.rate_hz)
    for written, read in ((session.tracks, again.tracks), (session.pointers, again.pointers)):
        found = {each.viewer: each for each in read}
        assert set(found) == {each.viewer for each in written}
        for track in written:
            for field in ("time_s", "position_m", "direction", "gaze", "acuity_arcmin"):
                assert same(getattr(found[track.viewer], field), getattr(track, field)), field
    assert ("role" in path.read_text(encoding="utf-8").splitlines()[1].split(",")) == bool(session.pointers)
    assert session_text(again) == path.read_text(encoding="utf-8")


def test_the_example_of_the_docs(tmp_path: Path):
    example, _ = re.findall(r"```csv\n(.*?)```", DOCS.read_text(encoding="utf-8"), flags=re.DOTALL)
    path = tmp_path / "visit.csv"
    path.write_text(example, encoding="utf-8")
    session = read_session(path)
    assert (session.name, session.display, session.rate_hz) == ("visit", "reality-deck", 120)
    assert session.duration_s == pytest.approx(3 / 120)
    ann, ben = session.at(0.0)
    assert (ann.name, ann.position_m, ann.acuity_arcmin) == ("ann", (-1.2, 1.68, -1.9), 0.5)
    assert ann.gaze is not None
    assert ben.gaze is None


def test_the_docs_session_with_a_pointer(tmp_path: Path):
    _, example = re.findall(r"```csv\n(.*?)```", DOCS.read_text(encoding="utf-8"), flags=re.DOTALL)
    path = tmp_path / "tour.csv"
    path.write_text(example, encoding="utf-8")
    session = read_session(path)
    assert [track.viewer for track in session.tracks] == [track.viewer for track in session.pointers] == ["ann"]
    (pointer,) = session.pointers_at(0.0)
    assert (pointer.name, pointer.position_m) == ("ann", (0.2, 1.28, 0.4))
    path.write_text(example.replace(",viewer,", ",,").replace("time_s,,", "time_s,viewer,"), encoding="utf-8")
    assert session_text(read_session(path)) == session_text(session), "an empty role is a viewer"


def test_the_message_of_the_docs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    text = DOCS.read_text(encoding="utf-8")
    example, _ = re.findall(r"```csv\n(.*?)```", text, flags=re.DOTALL)
    (message,) = re.findall(r"```text\nlimen: (.*?)\n```", text, flags=re.DOTALL)
    lines = example.splitlines()
    lines.insert(4, "0.004,ben,2.0,1.75,0.4,0,0,0,,,,")
    monkeypatch.chdir(tmp_path)
    Path("visit.csv").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(SessionError) as caught:
        read_session("visit.csv")
    assert str(caught.value) == message


def test_spreadsheets_and_editors_may_touch_a_file(tmp_path: Path):
    path = tmp_path / "s.csv"
    path.write_bytes(
        b"\xef\xbb\xbf" + (HEADER + "\n# a remark\n" + COLUMNS + ROW + "\n").replace("\n", "\r\n").encode()
    )
    assert read_session(path).at(0.0)[0].position_m == (1, 2, 3)


@pytest.mark.parametrize(
    ("content", "line", "says"),
    [
        ("", 1, "empty"),
        ("\n\n", 1, "empty"),
        ("time_s,x\n1,2\n", 1, "not a session file"),
        ("# limen session 2: {}\n" + COLUMNS + ROW, 1, "version '2'"),
        ('# limen session 1: {"name": "s"}\n' + COLUMNS + ROW, 1, "header: .*display"),
        ("# limen session 1: {nonsense\n" + COLUMNS + ROW, 1, "header"),
        ('# limen session 1: {"name": "s", "display": "d", "rate_hz": 0}\n' + COLUMNS + ROW, 1, "rate_hz"),
        (HEADER, 1, "nothing below the first line"),
        (HEADER + COLUMNS, 2, "no samples"),
        (HEADER + COLUMNS.replace("z_m,", "") + ROW, 2, "column z_m is missing"),
        (HEADER + COLUMNS.strip() + ",gaze_x\n" + ROW, 2, "column gaze_y is missing"),
        (HEADER + COLUMNS.strip() + ",colour\n" + ROW, 2, "column 'colour' is unknown"),
        (HEADER + COLUMNS.strip() + ",x_m\n" + ROW, 2, "column 'x_m' is unknown or there twice"),
        (HEADER + ROLES + "0.0,v1,watcher,1,2,3,0,0,-1\n", 3, "role is 'watcher'; there are viewer and pointer"),
        (HEADER + ROLES + ROLE + "1.0,p,pointer,1,2,3,0,0,0\n", 4, "direction of pointer 'p' is zero"),
        (HEADER + ROLES.strip() + ",acuity_arcmin\n0,p,pointer,1,2,3,0,0,1,1\n", 3, "a pointer has no eyes"),
        (HEADER + COLUMNS + ROW + "1.0,v1,1,2\n", 4, "4 cells for 8 columns"),
        (HEADER + COLUMNS + ROW + "1.0,v1,nan,2,3,0,0,-1\n", 4, "x_m is 'nan'"),
        (HEADER + COLUMNS + ROW + "1.0,v1,1,2,inf,0,0,-1\n", 4, "z_m is 'inf'"),
        (HEADER + COLUMNS + ROW + "1.0,v1,1,,3,0,0,-1\n", 4, "y_m is ''"),
        (HEADER + COLUMNS + ROW + "1.0,v1,one,2,3,0,0,-1\n", 4, "x_m is 'one', which is not a number"),
        (HEADER + COLUMNS + ROW + "1.0,v1,1,2,3,0,0,0\n", 4, "direction of viewer 'v1' is zero"),
        (HEADER + COLUMNS + ROW + "1.0,v2,1,2,3,0,0,1\n\n-1.0,v1,1,2,3,0,0,1\n", 6, "time_s of viewer 'v1' does not"),
        (HEADER + COLUMNS.strip() + ",acuity_arcmin\n0,v1,1,2,3,0,0,-1,0\n", 3, "acuity_arcmin of viewer 'v1' must"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_named_by_line(tmp_path: Path, content: str, line: int, says: str):
    path = tmp_path / "bad.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(SessionError, match=says) as caught:
        read_session(path)
    assert str(caught.value).startswith(f"{path}:{line}: ")
    assert "\n" not in str(caught.value)


def test_files_that_are_no_text(tmp_path: Path):
    with pytest.raises(MissingFileError, match="limen walk"):
        read_session(tmp_path / "none.csv")
    with pytest.raises(SessionError, match="text file"):
        read_session(tmp_path)
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(SessionError, match="text file"):
        read_session(tmp_path / "picture.csv")


def test_a_file_is_there_whole_or_not_at_all(tmp_path: Path):
    session = Session("s", "d", 1.0, (Track("v", np.zeros(1), np.zeros((1, 3)), np.ones((1, 3))),))
    with pytest.raises(MissingFileError, match="make it first"):
        write_session(tmp_path / "nowhere" / "s.csv", session)
    (tmp_path / "folder").mkdir()
    with pytest.raises(StorageError):
        write_session(tmp_path / "folder", session)
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]
    write_session(tmp_path / "s.csv", session)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder", "s.csv"]
    assert (tmp_path / "s.csv").stat().st_mode & stat.S_IRUSR


def test_pointers_alone_are_no_session(tmp_path: Path):
    path = tmp_path / "s.csv"
    path.write_text(HEADER + ROLES + "0.0,p,pointer,1,2,3,0,0,-1\n", encoding="utf-8")
    with pytest.raises(SessionError, match=r"s\.csv: session 's' has no viewers"):
        read_session(path)
