"""The files of the page as a browser gets them: these and no others, and nothing from elsewhere."""

import http.client
import threading
from collections.abc import Iterator
from importlib import resources

import pytest
from waiting import PATIENCE_S

from vsx_ros.ros import dashboard
from vsx_ros.ros.dashboard.feed import Board
from vsx_ros.ros.dashboard.server import ViewServer

TOKEN = "the-token"
KINDS = {"html": "text/html", "css": "text/css", "js": "text/javascript"}


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    server = ViewServer(Board(), {}, lambda _: None, TOKEN, port=0)
    server.report = lambda: b"<script>1</script>"
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_port
    server.close()


def get(port: int, path: str, **headers: str) -> tuple[http.client.HTTPResponse, str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
    connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    return answer, answer.read().decode()


def test_the_page_needs_nothing_from_elsewhere_and_runs_no_script_within_its_words(port: int) -> None:
    files = [file.name for file in resources.files(dashboard).joinpath("page").iterdir()]
    assert {"index.html", "style.css", "main.js", "map.js"} <= set(files)
    for path in ["", *files]:
        answer, text = get(port, f"/{path}")
        policy = str(answer.headers["Content-Security-Policy"])
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert answer.headers["Content-Type"] == f"{KINDS[path.rpartition('.')[2] or 'html']}; charset=utf-8"
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert len(text.splitlines()) <= 250, path
        assert max(map(len, text.splitlines())) <= 120, path
        assert "http://" not in text
        assert "https://" not in text
        assert TOKEN not in text


def test_a_report_is_self_contained_so_its_scripts_may_run(port: int) -> None:
    answer, text = get(port, "/report")
    assert text == "<script>1</script>"
    assert "script-src 'unsafe-inline'" in str(answer.headers["Content-Security-Policy"])


@pytest.mark.parametrize(
    "path", ["/../server.py", "/page/map.js", "/%2e%2e/server.py", "/map", "/MAP.JS", "/.", "/page"]
)
def test_no_other_file_is_served(port: int, path: str) -> None:
    assert get(port, path)[0].status == 404


def test_a_foreign_page_gets_no_script_of_the_page(port: int) -> None:
    assert get(port, "/main.js", Sec_Fetch_Site="cross-site")[0].status == 403
    assert get(port, "/main.js", Origin="http://evil.example")[0].status == 403
    assert get(port, "/main.js", Sec_Fetch_Site="same-origin")[0].status == 200
