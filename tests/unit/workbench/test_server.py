"""The door of the workbench: who may come in, and what is answered."""

import io
import json
import os
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("starlette", reason="the extra [serve]")
pytest.importorskip("httpx2", reason="starlette's test client needs it")

from starlette.testclient import TestClient

from halpipe.starters import first_model
from halpipe.workbench.server import FILES, LONGEST_NAME, MAX_BODY, ORDERS, _number, application
from halpipe.workbench.session import Session

TOKEN, PORT = "a-token", 8000
BASE = f"http://127.0.0.1:{PORT}"


@pytest.fixture
def client(tmp_path):
    path = tmp_path / "model.xml"
    path.write_bytes(first_model()["model.xml"])
    session = Session(str(path))
    session.begin()
    with TestClient(application(session, TOKEN, PORT), base_url=BASE) as made:
        made.session = session
        yield made


@pytest.fixture
def inside(client):
    assert client.get(f"/?token={TOKEN}").status_code == 200
    return client


def edit(client, value, revision=None):
    stated = {"kind": "version", "name": "camera", "inner": "full", "field": "wcet", "value": value}
    known = client.session.revision if revision is None else revision
    return client.post("/api/edit", json=stated | {"revision": known})


def test_nobody_comes_in_without_the_token(client):
    for path in ("/", "/workbench.js", "/api/state", "/?token=other", "/?token="):
        assert client.get(path).status_code == 403
    assert client.post("/api/undo", json={}).status_code == 403


def test_the_token_leaves_the_address_at_once(client):
    answer = client.get(f"/?token={TOKEN}", follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:8000", ""])
def test_other_names_of_the_server_are_refused(inside, host):
    assert inside.get("/api/state", headers={"host": host}).status_code == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:8000", "http://127.0.0.1:8001"])
def test_orders_of_other_pages_are_refused(inside, origin):
    assert inside.post("/api/undo", json={}, headers={"origin": origin}).status_code == 403


def test_orders_of_the_own_page_are_taken(inside):
    order = {"revision": inside.session.revision}
    assert inside.post("/api/undo", json=order, headers={"origin": BASE}).status_code == 200


def test_long_orders_are_refused(inside):
    assert inside.post("/api/edit", content=b"x" * (MAX_BODY + 1)).status_code == 413


@pytest.mark.parametrize("name", FILES)
def test_pages_load_nothing_from_elsewhere(inside, name):
    answer = inside.get(f"/{name}")
    assert answer.status_code == 200
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert "http://" not in answer.text.replace("http://www.w3.org", "")
    assert "https://" not in answer.text


def test_the_pages_are_small(inside):
    assert sum(len(inside.get(f"/{name}").content) for name in FILES) < 400_000


@pytest.mark.parametrize("path", ["/../session.py", "/static/workbench.js", "/%2e%2e/session.py", "/api", "/api/x/y"])
def test_there_are_no_other_files(inside, path):
    assert inside.get(path).status_code == 404


def test_an_edit_answers_with_the_new_state(inside):
    answer = edit(inside, "7ms")
    assert answer.status_code == 200
    assert answer.json()["tasks"][0]["versions"][0]["wcet"] == "7ms"


def test_an_edit_is_answered_with_what_is_drawn_then_with_what_is_verified(inside):
    drawn = edit(inside, "7ms").json()
    assert not drawn["solved"]
    assert not drawn["valid"]
    settled = inside.post("/api/settle", json={"revision": drawn["revision"]}).json()
    assert settled["solved"]
    assert settled["valid"]
    assert settled["revision"] == drawn["revision"]


def test_a_wrong_edit_answers_with_its_code_and_the_state_as_it_was(inside):
    answer = edit(inside, "fast")
    assert answer.status_code == 409
    assert answer.json()["refused"][0]["code"] == "HAL0951"
    assert answer.json()["tasks"][0]["versions"][0]["wcet"] == "6ms"


def test_an_edit_of_an_older_state_is_refused(inside):
    assert edit(inside, "7ms", revision=1).status_code == 200
    assert edit(inside, "8ms", revision=1).json()["refused"][0]["code"] == "HAL0952"


@pytest.mark.parametrize("order", [*ORDERS, "unknown"])
@pytest.mark.parametrize(
    "body", [b"", b"[]", b"{}", b'{"revision": []}', b"[" * 5000, b"\xff", b'{"start": 1, "name": {}}']
)
def test_any_order_is_answered(inside, order, body):
    answer = inside.post(f"/api/{order}", content=body)
    assert answer.status_code in (200, 409)
    assert "revision" in answer.json()


def test_the_token_admits_one_browser_once(client):
    """Its address stays in histories and lists of processes."""
    assert client.get(f"/?token={TOKEN}").status_code == 200
    assert client.get(f"/?token={TOKEN}").status_code == 200  # the same browser, which is known
    client.cookies.clear()
    assert client.get(f"/?token={TOKEN}").status_code == 403


def test_workbenches_of_other_ports_keep_their_cookies(inside):
    """Browsers send the cookies of a host to all its ports."""
    (name,) = inside.cookies
    assert str(PORT) in name
    assert inside.cookies[name] != TOKEN


WRONG = (
    '"\\ud800"', "1e999", "-1", '"x"', "null", "true", "[]", "{}", '{"a": 1}', '"' + "x" * 5000 + '"',
    "[" * 900 + "]" * 900, "1.5",
    "NaN", '"\\u0000"', "99999999999999999999999999", '"../../etc"', '""', "Infinity",
)  # fmt: skip


NEVER = ("1e999", "[]", "NaN", '"\\u0000"', '{"a": 1}')
"""Values that no field takes."""

EXTRA = ("colour", "", "Revision")
RIGHT = {
    "edit": {"kind": "version", "name": "camera", "inner": "full", "field": "wcet", "value": "6ms"},
    "pin": {"mode": "drive", "task": "camera", "index": 0, "start": "0ms", "unit": "core1"},
    "take": {"name": "kept"},
    "keep": {"name": "kept"},
    "beside": {"kind": "variant", "name": "kept"},
    "save": {"path": "new.xml"},
    "explain": {"mode": "drive"},
    "export/report": {"title": "a title"},
}
RIGHT |= {order: {} for order in {*ORDERS} - RIGHT.keys()}
LIVE = {("keep", "name"), ("save", "path"), ("edit", "value"), ("export/report", "title"), ("pin", "index"),
        ("explain", "mode"), ("pin", "unit")}  # fmt: skip
"""Fields that take other texts or numbers, too."""


@pytest.mark.slow
def test_a_thousand_wrong_orders_leave_the_server_as_it_was(inside, monkeypatch):
    """Orders that are right but for one field: with a wrong value, missing, too many, or of another state."""
    monkeypatch.setattr(inside.session, "_solved", lambda *_: pytest.fail("a wrong order is not solved"))
    seen, count, folder = inside.get("/api/state").json(), 0, Path(inside.session.path).parent
    files = {path: path.read_bytes() for path in folder.iterdir()}
    for order, fields in RIGHT.items():
        right = fields | {"revision": inside.session.revision}
        needed = [key for key in right if (order, key) not in LIVE]
        bodies = [json.dumps({key: right[key] for key in right if key != left}) for left in needed]
        bodies += [json.dumps(right | {"revision": value}) for value in (0, 9, -1, True, 1.0, "1", None)]
        bodies += [json.dumps(right)[:-1] + f', "{key}": {value}}}' for key in EXTRA for value in WRONG]
        for key in right:
            wrong = [value for value in WRONG if (order, key) not in LIVE or value in NEVER]
            others = {each: right[each] for each in right if each != key}
            bodies += [json.dumps({"revision": 0, **others})[:-1] + f', "{key}": {value}}}' for value in wrong]
        for body in bodies:
            answer = inside.post(f"/api/{order}", content=body.encode())
            assert answer.status_code == 409, (order, body)
            count += 1
    assert count > 1000
    assert inside.get("/api/state").json() == seen
    assert {path: path.read_bytes() for path in folder.iterdir()} == files


@pytest.mark.parametrize("order", ["edit", "keep", "export/report", "export/btf"])
@pytest.mark.parametrize(
    "body", [b'{"name": "\\ud800"}', b'{"revision": 1e999}', b'{"title": ' + b"[" * 3000 + b"]" * 3000 + b"}"]
)
def test_what_json_cannot_carry_back_is_refused(inside, order, body):
    before = inside.get("/api/state").json()
    assert inside.post(f"/api/{order}", content=body).status_code == 409
    assert inside.get("/api/state").json() == before


@pytest.mark.parametrize("fields", ['"name": "\\ud800"', '"name": "a\\u0000"', '"name": null', '"name": 1'])
def test_names_are_texts_that_a_page_can_show(inside, fields):
    body = b'{"revision": %d, %s}' % (inside.session.revision, fields.encode())
    assert inside.post("/api/keep", content=body).json()["refused"][0]["code"] == "HAL0955"
    assert inside.get("/api/state").json()["variants"] == []


def test_a_number_beyond_all_is_no_title(inside):
    body = b'{"revision": %d, "title": 1e999}' % inside.session.revision
    assert inside.post("/api/export/report", content=body).json()["refused"][0]["code"] == "HAL0955"


def test_names_of_variants_have_a_longest_length(inside):
    for length, status in ((LONGEST_NAME, 200), (LONGEST_NAME + 1, 409)):
        order = {"revision": inside.session.revision, "name": "x" * length}
        assert inside.post("/api/keep", json=order).status_code == status


def save(client, **fields):
    return client.post("/api/save", json={"revision": client.session.revision, **fields})


def test_the_page_saves_over_a_file_only_on_purpose(inside, tmp_path):
    edit(inside, "7ms")
    for force, code in (({}, "HAL0953"), ({"force": False}, "HAL0953"), ({"force": "no"}, "HAL0955")):
        assert save(inside, **force).json()["refused"][0]["code"] == code
    assert save(inside, path=str(tmp_path / "new.xml")).json()["said"].endswith("new.xml: written")
    assert save(inside, force=True).json()["said"].endswith("model.xml: written")
    assert (tmp_path / "new.xml").read_bytes() == (tmp_path / "model.xml").read_bytes()


def test_an_order_that_repeats_a_field_is_refused(inside):
    body = b'{"revision": %d, "revision": %d}' % (0, inside.session.revision)
    assert inside.post("/api/undo", content=body).json()["refused"][0]["code"] == "HAL0955"


def test_an_order_that_is_none_is_said_to_be_so(inside):
    assert inside.post("/api/edit", json=[]).json()["refused"][0]["code"] == "HAL0955"


def test_exports_come_as_files(inside):
    report = inside.post("/api/export/report", json={"revision": 1, "title": "of today"})
    assert b"<h1>of today</h1>" in report.content
    assert report.content.startswith(b"<!DOCTYPE html>")
    assert 'filename="export.html"' in report.headers["content-disposition"]
    packed = inside.post("/api/export/linux", json={"revision": 1, "busy": 50})
    with zipfile.ZipFile(io.BytesIO(packed.content)) as archive:
        assert "manifest.json" in archive.namelist()
    assert inside.post("/api/export/nonsense", json={"revision": 1}).json()["refused"][0]["code"] == "HAL0901"


@pytest.mark.parametrize("option", ["format", "model", "strict", "", "platform"])
def test_options_that_an_export_has_not_are_refused(inside, option, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for format in ("report", "regulator"):  # a platform in a pipe, and none at all
        answer = inside.post(f"/api/export/{format}", json={"revision": 1, option: str(tmp_path / "pipe")})
        assert answer.status_code == 409


def test_an_order_may_be_as_long_as_the_limit(inside):
    assert inside.post("/api/undo", content=b" " * MAX_BODY).status_code != 413


def test_how_far_a_search_is_comes_by_its_parts(inside):
    inside.session.progress = ("drive", 3, 9)
    assert inside.get("/api/progress").json() == {"mode": "drive", "made": 3, "allowed": 9}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_a_pipe_is_no_trace_and_a_file_is_read_as_one(inside, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("")
    said = {}
    for name in ("pipe", "file"):
        stated = {"kind": "trace", "name": str(tmp_path / name), "revision": inside.session.revision}
        said[name] = inside.post("/api/beside", json=stated).text
    assert {name for name, text in said.items() if "is no plain file" in text} == {"pipe"}


@pytest.mark.parametrize("number", ["1", True, None, 1.5])
def test_numbers_of_orders_are_whole(number):
    with pytest.raises(TypeError):
        _number({"revision": number}, "revision")
    assert _number({"revision": 1}, "revision") == 1
