"""Hostile requests and hostile run directories: refused, never served, never a server's error."""

from __future__ import annotations

import random
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from starlette.testclient import TestClient
from tests.hostile.mutations import Payloads, mutate_json, mutate_npz
from tests.plugins.view.serving import (
    PORT,
    SECRET,
    Thread,
    application,
    client_of,
    exchange,
    serving,
)

from hillsphere_view.guard import MAX_BODY_BYTES, Session

UP = "../../secret.txt"
TRAVERSALS = (
    UP, "..", "../..", "../../../../../../etc/passwd", quote(UP, safe=""),
    quote(quote(UP, safe=""), safe=""), "..%2f..%2fsecret.txt", "..%252f..%252fsecret.txt",
    "%2e%2e/%2e%2e/secret.txt", "..%5c..%5csecret.txt", "..%c0%af..%c0%afsecret.txt",
    "%2e%2e%2f%2e%2e%2fsecret.txt%00", "....//....//secret.txt", "/etc/passwd", "%2fetc%2fpasswd",
    "~", "one%00", "one%2f..%2f..%2f..%2fsecret.txt", "linked", "linked/secret.txt", "file:///etc",
    "%ff%fe", "%ed%a0%80", "x" * 5000,
)  # fmt: skip
ROUTES = (
    "/{}", "/runs/{}", "/runs/{}/one", "/runs/0/{}", "/runs/0/{}/report.html",
    "/runs/0/one/tables/{}", "/runs/0/one/files/{}", "/runs/0/one/figures/{}",
    "/runs/0/one/cases/{}", "/runs/0/one/cases/many/{}", "/runs/0/one/cases/{}/3/history.svg",
    "/runs/0/one/cases/many/3/history.{}", "/static/{}", "/start/{}", "/compare/figure?run=0/one"
    "&run=0/two&name={}", "/compare?run=0/one&run=0/{}", "/compare?run=0/one&run={}",
)  # fmt: skip
PAGES = (
    "/", "/start", "/start/file:0", "/runs/0/one", "/runs/0/one/report.html", "/static/view.js",
    "/runs/0/one/cases/many", "/runs/0/one/cases/many/3", "/runs/0/one/figures/wave",
    "/compare?run=0/one&run=0/two", "/compare/figure?run=0/one&run=0/two&name=wave",
)  # fmt: skip
POSTS = (
    "/start/file:0/run", "/runs/0/one/resume", "/runs/0/one/stop",
    "/runs/0/one/cases/many/3/repeat",
)  # fmt: skip


@pytest.fixture(scope="module")
def server(place: Path) -> Iterator[Thread]:
    (place / "runs" / "linked").symlink_to(place)
    try:
        with serving(place) as made:
            yield made
    finally:
        (place / "runs" / "linked").unlink()


def refuse(server: Thread, status: int, body: bytes, what: object) -> None:
    assert 400 <= status < 500, (status, what)
    assert SECRET.encode() not in body, what
    assert b"root:" not in body, what


def test_no_path_leads_outside(server: Thread) -> None:
    count = 0
    for route in ROUTES:
        for text in TRAVERSALS:
            target = route.replace("{}", text)
            refuse(server, *server.ask(f"GET {target}"), target)
            count += 1
    assert count >= 200
    assert server.ask("GET /runs/0/one")[0] == 200


def test_nothing_without_the_cookie(server: Thread) -> None:
    own = server.session
    for page in PAGES:
        assert server.ask(f"GET {page}", cookie=False)[0] == 403
        assert server.ask(f"GET {page}")[0] == 200
        for cookie in ("", own.token, own.cookie[:-1], own.cookie + "x", "é"):
            pair = f"Cookie: {own.cookie_name}={cookie}"
            assert server.ask(f"GET {page}", pair, cookie=False)[0] == 403
    for page in POSTS:
        assert server.ask(f"POST {page}", "Content-Length: 0", cookie=False)[0] == 403
    for query in ("token=", "token=x", f"token={own.token[:-1]}", f"token={own.cookie}",
                  f"token={own.token}&token={own.token}", f"Token={own.token}"):  # fmt: skip
        assert server.ask(f"GET /?{query}", cookie=False)[0] == 403
    assert server.ask(f"GET /start?token={own.token}", cookie=False)[0] == 403
    assert server.ask(f"POST /?token={own.token}", "Content-Length: 0", cookie=False)[0] == 403


def test_only_under_its_own_name_and_from_its_own_pages(server: Thread) -> None:
    port = server.session.port
    for host in ("example.org", f"example.org:{port}", "127.0.0.1", "127.0.0.1:1", "localhost",
                 f"127.0.0.1:{port}.example.org", f"0.0.0.0:{port}", f"[::1]:{port}", "",
                 f"127.1:{port}", f"localhost.:{port}"):  # fmt: skip
        for page in PAGES[:3]:
            status, body = server.ask(f"GET {page}", host=host)
            assert status in (400, 403)
            refuse(server, status, body, host)
    own = f"127.0.0.1:{port}"
    for origin in ("null", "http://example.org", f"https://{own}", "http://127.0.0.1", "",
                   f"http://localhost:{port}", f"http://{own}/", f"http://{own}.example.org",
                   f"http://{own} http://example.org"):  # fmt: skip
        for page in (*POSTS, "/"):
            method = "GET" if page == "/" else "POST"
            assert server.ask(f"{method} {page}", "Content-Length: 0", origin=origin)[0] == 403
    cookie = f"Cookie: {server.session.cookie_name}={server.session.cookie}"
    for page in POSTS:
        head = f"POST {page} HTTP/1.1\r\nHost: {own}\r\nConnection: close\r\n{cookie}\r\n\r\n"
        assert exchange(port, head.encode())[0] == 403  # without an origin
    twice = f"GET / HTTP/1.1\r\nHost: {own}\r\nHost: example.org\r\n{cookie}\r\n\r\n"
    assert exchange(port, twice.encode())[0] in (400, 403)
    assert exchange(port, f"GET / HTTP/1.0\r\n{cookie}\r\n\r\n".encode())[0] == 403
    local = f"localhost:{port}"
    assert server.ask("GET /", host=local, origin=f"http://{local}")[0] == 200


def test_wrong_methods(server: Thread) -> None:
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "PROPFIND"):
        for page in PAGES:
            path = page.partition("?")[0]
            assert server.ask(f"{method} {path}", "Content-Length: 0")[0] == 405, (method, path)
    for page in POSTS:
        # A route of files stands beside: what it does not hold is not there.
        assert server.ask(f"GET {page}")[0] in (404, 405)
        assert server.ask(f"PUT {page}", "Content-Length: 0")[0] == 405
    for page in ("/none", "/runs", "/runs/0", "/runs/", "/start/", "//", "/%2e", "/favicon.ico",
                 "/runs/0/one/", "/runs/0/one/none/x", "/runs/0/one/manifest.json",
                 "/runs/0/one/tables/", "/static/", "http://example.org/", "*"):  # fmt: skip
        status, body = server.ask(f"GET {page}")
        refuse(server, status, body, page)
        assert status == 404, page


def test_large_and_odd_bodies(server: Thread) -> None:
    large = MAX_BODY_BYTES + 1
    form = "Content-Type: application/x-www-form-urlencoded"
    for page in (*POSTS, "/none", "/"):
        assert server.ask(f"POST {page}", f"Content-Length: {large}")[0] == 413
        assert server.ask(f"POST {page}", f"Content-Length: {large}", body=b"a" * large)[0] == 413
        assert server.ask(f"POST {page}", f"Content-Length: {10**30}")[0] in (400, 413)
        chunks = b"10000\r\n" + b"a" * 65536 + b"\r\n5\r\naaaaa\r\n0\r\n\r\n"
        assert server.ask(f"POST {page}", "Transfer-Encoding: chunked", body=chunks)[0] == 413
        for length in ("-1", "1e3", "0x10", "", "1, 2"):
            status, body = server.ask(f"POST {page}", f"Content-Length: {length}", body=b"a")
            refuse(server, status, body, length)
    assert server.ask("GET /", f"Content-Length: {large}", body=b"a" * large)[0] == 413
    start = "POST /start/file:0/run"
    for kind in ("application/json", "multipart/form-data; boundary=x", "text/plain", ""):
        body = b"{}"
        status = server.ask(start, f"Content-Type: {kind}", f"Content-Length: {len(body)}",
                            body=body)[0]  # fmt: skip
        assert status == 415
    for body in (
        b"profile=%ff", b"profile=\xff", b"profile=fast&profile=fast", b"&a=1" * 70,
        b"profile=none", b"profile=%00", b"profile=--out%3dx", b"sets=%00", b"sets=a%00%3d1",
        b"sets=--out%3d%2ftmp%2fx", b"sets=seed", b"sets=%3d", b"sets=stage.wave.steps%3d0",
        b"sets=" + b"a" * 60_000, b"sets=" + b"%0aseed%3d1x" * 5000, b"sets=name%3d'..%2f..%2fx'",
        b"sets=stage.wave.steps%3d%5b%5b%5b%5b", b"sets=%ed%a0%80%3d1",
    ):  # fmt: skip
        status, answer = server.ask(start, form, f"Content-Length: {len(body)}", body=body)
        refuse(server, status, answer, body[:40])
    for query in ("page=x", "page=-1", "page=1e3", f"page={'9' * 5000}", "page="):
        assert server.ask(f"GET /?{query}")[0] == 400
    for query in ("class=x", "low=nan", "low=x", "high=1,2", "metric=..%2f..", "page=x"):
        status, answer = server.ask(f"GET /runs/0/one/cases/many?{query}")
        refuse(server, status, answer, query)
    for query in ("", "run=0/one", "run=0/one&run=0/one", "&run=0/one" * 9, "run=&run="):
        refuse(server, *server.ask(f"GET /compare?{query}"), query)
    head = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{server.session.port}\r\nX: ".encode()
    assert exchange(server.session.port, head + b"a" * 200_000 + b"\r\n\r\n")[0] == 400
    assert server.ask("GET /")[0] == 200


def test_every_answer_has_the_headers(client: TestClient) -> None:
    for page in (*PAGES, "/none", "/runs/0/none", "/compare"):
        headers = client.get(page).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cache-control"] == "no-store"
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        if "report.html" not in page:
            scripts = policy.partition("script-src")[2].partition(";")[0].strip()
            assert scripts in ("", f"http://127.0.0.1:{PORT}/static/")


def test_token_becomes_a_cookie_that_scripts_and_other_sites_lack(place: Path) -> None:
    session = Session(PORT)
    app = application(place, session)
    client = TestClient(app, f"http://127.0.0.1:{PORT}")
    assert client.get("/").status_code == 403
    answer = client.get(session.address)
    assert answer.status_code == 200
    cookie = answer.headers["set-cookie"]
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= {p.strip() for p in cookie.split(";")}
    assert session.token not in cookie
    assert ">two</a>" in client.get("/").text
    assert session.token not in repr(session)


def test_templates_have_no_script_of_their_own() -> None:
    import hillsphere_view

    folder = Path(hillsphere_view.__file__).parent / "templates"
    for path in folder.glob("*.html"):
        text = path.read_text("utf-8")
        assert re.search(r"<[^<>%]*\son\w+\s*=", text) is None, path
        assert "style=" not in text, path
        assert "|safe" not in text, path


# --- run directories of strangers


@pytest.fixture
def stranger(place: Path) -> Iterator[tuple[TestClient, Path]]:
    """Client, and a copy of a run that may be spoilt."""
    copy = place / "runs" / "stranger"
    shutil.copytree(place / "runs" / "one", copy)
    session = Session(PORT)
    try:
        yield client_of(application(place, session), session), copy
    finally:
        shutil.rmtree(copy)


SPOILT = (
    "/", "/runs/0/stranger", "/runs/0/stranger/report.html", "/runs/0/stranger/figures/wave",
    "/compare?run=0/one&run=0/stranger", "/compare?run=0/stranger&run=0/one",
    "/compare/figure?run=0/stranger&run=0/one&name=wave", "/runs/0/stranger/cases/many",
    "/runs/0/stranger/cases/many/3",
)  # fmt: skip


@pytest.mark.parametrize("seed", range(8))
def test_spoilt_records_are_no_error_of_the_server(
    stranger: tuple[TestClient, Path], tmp_path: Path, seed: int
) -> None:
    client, run = stranger
    chance, payloads = random.Random(seed), Payloads(tmp_path, 9)
    for name in ("manifest.json", "summary.json", "figures/wave.json", "resume.json") * 5:
        file = run / name
        data = file.read_bytes()
        for _ in range(chance.randint(1, 3)):
            file.write_bytes(mutate_json(chance, file.read_bytes(), payloads))
        spoilt = file.read_bytes()
        for page in SPOILT:
            answer = client.get(page)  # the client raises what the server does not catch
            assert answer.status_code < 500, (page, spoilt)
            if answer.headers["content-type"].startswith("text/html") and "report" not in page:
                assert "<script>alert" not in answer.text
        file.write_bytes(data)


@pytest.mark.parametrize("seed", range(4))
def test_spoilt_tables_are_no_error_of_the_server(
    stranger: tuple[TestClient, Path], tmp_path: Path, seed: int
) -> None:
    from hashlib import sha256

    client, run = stranger
    chance = random.Random(seed)
    data, manifest = (run / "many.npz").read_bytes(), (run / "manifest.json").read_text("utf-8")
    digest = sha256(data).hexdigest()
    for _ in range(12):
        spoilt = mutate_npz(chance, data, Payloads(tmp_path, 9))
        (run / "many.npz").write_bytes(spoilt)
        (run / "manifest.json").write_text(
            manifest.replace(digest, sha256(spoilt).hexdigest()), "utf-8"
        )
        for query in ("", "?class=failure&metric=folded&low=0", "/3"):
            answer = client.get(f"/runs/0/stranger/cases/many{query}")
            assert answer.status_code < 500, query


def test_text_of_a_stranger_is_text(stranger: tuple[TestClient, Path]) -> None:
    client, run = stranger
    for name, old in (("manifest.json", '"name": "waves"'), ("manifest.json", '"command": "'),
                      ("summary.json", '"text": "')):  # fmt: skip
        file = run / name
        data = file.read_text("utf-8")
        new = old[:-1] + "<img src=x onerror=alert(1)>&\\ud800" + old[-1]
        if old.endswith(': "'):
            new = old + "<img src=x onerror=alert(1)>&\\ud800"
        assert old in data
        file.write_text(data.replace(old, new, 1), "utf-8")
    for page in ("/", "/runs/0/stranger", "/compare?run=0/one&run=0/stranger"):
        text = client.get(page).text
        assert "<img src=x" not in text
        assert "&lt;img src=x" in text


def test_links_are_refused(stranger: tuple[TestClient, Path], place: Path) -> None:
    client, run = stranger
    for name in ("report.html", "tables/x.csv", "figures/x.json", "cases/many-3.svg"):
        link = run / name
        link.parent.mkdir(exist_ok=True)
        kept = link.read_bytes() if link.exists() else None
        link.unlink(missing_ok=True)
        link.symlink_to(place / "secret.txt")
        page = name.replace(".json", "").replace("cases/many-3.svg", "cases/many/3/history.svg")
        answer = client.get(f"/runs/0/stranger/{page}")
        assert 400 <= answer.status_code < 500
        assert SECRET not in answer.text
        assert client.get("/runs/0/stranger").status_code == 404  # a run makes no links
        link.unlink()
        if kept is not None:
            link.write_bytes(kept)
    assert client.get("/runs/0/stranger").status_code == 200
    shutil.move(run / "tables", run / "moved") if (run / "tables").exists() else None
    (run / "tables").symlink_to(place)
    assert client.get("/runs/0/stranger/tables/secret.txt").status_code == 404
    (run / "tables").unlink()
