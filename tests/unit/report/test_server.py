"""The server of `unlit view`: this machine only, the result's own files only, safe headers."""

import http.client
import os
import socket
import threading

import pytest

from unlit.errors import OutputError
from unlit.report.server import ReportServer


@pytest.fixture
def folder(tmp_path):
    result = tmp_path / "result"
    result.mkdir()
    (result / "report.html").write_text("<!doctype html>the report")
    (result / "metrics.json").write_text("{}")
    (result / "notes.txt").write_text("private")
    (result / "sub").mkdir()
    (result / "sub" / "metrics.json").write_text("private")
    (tmp_path / "metrics.json").write_text("private")
    return result


@pytest.fixture
def server(folder):
    with ReportServer(folder) as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def ask(server, target, method="GET", host=None):
    """Status, headers and body; the target goes out as it is, not tidied up as browsers do."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=5)
    connection.putrequest(method, target, skip_host=True, skip_accept_encoding=True)
    if host != "":
        connection.putheader("Host", host or f"127.0.0.1:{server.server_port}")
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, answer.headers, body


def test_the_root_is_the_report(server):
    for target in ("/", "/report.html", "/?x=1"):
        status, headers, body = ask(server, target)
        assert (status, body) == (200, b"<!doctype html>the report")
        assert headers["Content-Type"] == "text/html; charset=utf-8"


def test_head_has_no_body(server):
    status, headers, body = ask(server, "/metrics.json", "HEAD")
    assert (status, headers["Content-Length"], body) == (200, "2", b"")


def test_headers_are_safe_also_on_errors(server):
    for target in ("/", "/absent"):
        _, headers, _ = ask(server, target)
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["X-Frame-Options"] == "DENY"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert headers["Cache-Control"] == "no-store"
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert "Access-Control-Allow-Origin" not in headers
        assert "Python" not in headers["Server"]


@pytest.mark.parametrize(
    "target",
    [
        "/notes.txt",
        "/sub/metrics.json",
        "/../metrics.json",
        "/%2e%2e/metrics.json",
        "/..%2fmetrics.json",
        "/sub/../metrics.json",
        "/./metrics.json",
        "\\..\\metrics.json",
        "/metrics.json%00.png",
        "/etc/passwd",
        "//etc/passwd",
        "/sub",
        "/sub/",
        "metrics.jsonx",
        "http://127.0.0.1/metrics.json",
    ],
)
def test_nothing_else_is_served(server, target):
    status, _, body = ask(server, target)
    assert status == 404
    assert b"private" not in body


def test_a_link_out_of_the_folder_is_not_followed(server, folder):
    (folder / "mesh.obj").symlink_to(folder.parent / "metrics.json")
    assert ask(server, "/mesh.obj")[0] == 404


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", ""])
def test_foreign_names_are_refused(server, host):
    """DNS rebinding: a page of evil.example whose name now points to 127.0.0.1."""
    status, _, body = ask(server, "/", host=host)
    assert status == 421
    assert b"the report" not in body


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_it_only_reads(server, method):
    assert ask(server, "/", method)[0] == 501


def test_it_listens_on_the_loopback_only(server):
    assert server.server_address[0] == "127.0.0.1"
    assert server.address == f"http://127.0.0.1:{server.server_port}/"
    # 127.0.0.2 is this machine as well, but not the address it listens on.
    if os.uname().sysname == "Linux":
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", server.server_port), timeout=2)


def test_a_port_in_use_is_one_line(server, folder):
    with pytest.raises(OutputError, match=f"port {server.server_port}: cannot be used"):
        ReportServer(folder, server.server_port)


def test_a_forwarded_port_is_served(server):
    """`ssh -L 9000:localhost:PORT`: the browser names the port it was given."""
    assert ask(server, "/", host="localhost:9000")[0] == 200
