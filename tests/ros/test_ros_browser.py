"""Opening the live view never holds up a run, nor takes its terminal."""

import os
import threading
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from waiting import PATIENCE_S, wait_for

from vsx_ros.ros.browser import open_browser

URL = "http://127.0.0.1:8765/#token"


class Desktop:
    """A folder of browsers, the only programs that are found. Each writes what it is asked for, and those that wait
    are open until ``close``."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self._closed = folder, folder / "closed"
        monkeypatch.setenv("PATH", str(folder))
        monkeypatch.setenv("DISPLAY", ":9")
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.delenv("BROWSER", raising=False)

    def install(self, *names: str) -> None:
        for name in names:
            file = self.folder / name
            file.write_text(
                f'#!/bin/sh\necho "$@" > {file}.opened\n'
                f"for _ in $(/usr/bin/seq 400); do [ -e {self._closed} ] || /bin/sleep 0.05; done\n"
                f"echo > {file}.ended\n"
            )
            file.chmod(0o755)

    def files(self, what: str) -> dict[str, str]:
        return {file.stem: file.read_text().strip() for file in self.folder.glob(f"*.{what}")}

    def close(self) -> None:
        self._closed.touch()
        for thread in threading.enumerate():
            if thread.name == "browser":
                thread.join(PATIENCE_S)


@pytest.fixture
def desktop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desktop:
    return Desktop(tmp_path, monkeypatch)


def test_a_browser_that_is_open_holds_nothing_up(desktop: Desktop, monkeypatch: pytest.MonkeyPatch) -> None:
    desktop.install("mine")
    monkeypatch.setenv("BROWSER", f"{desktop.folder / 'mine'} %s")
    open_browser(URL)
    assert not desktop.files("ended")
    wait_for(lambda: desktop.files("opened") == {"mine": URL})
    assert not desktop.files("ended")
    desktop.close()


def test_browsers_of_the_terminal_are_left_out(desktop: Desktop, monkeypatch: pytest.MonkeyPatch) -> None:
    desktop.install("w3m", "lynx", "www-browser", "links", "elinks", "firefox")
    monkeypatch.setenv(
        "BROWSER", os.pathsep.join(["w3m", "", "/usr/bin/lynx -color %s", str(desktop.folder / "links")])
    )
    open_browser(URL)
    wait_for(lambda: desktop.files("opened") == {"firefox": URL})
    desktop.close()
    assert desktop.files("opened") == {"firefox": URL}


def test_without_a_graphical_browser_none_is_opened(desktop: Desktop) -> None:
    desktop.install("w3m", "lynx", "www-browser", "links", "elinks")
    open_browser(URL)
    desktop.close()
    assert desktop.files("opened") == {}


def test_without_a_display_none_is_opened(desktop: Desktop, monkeypatch: pytest.MonkeyPatch) -> None:
    desktop.install("firefox")
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    open_browser(URL)
    desktop.close()
    assert desktop.files("opened") == {}


def test_a_machine_that_starts_no_process_goes_on(desktop: Desktop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.executable", str(desktop.folder / "nothing"))
    open_browser(URL)
    desktop.close()
