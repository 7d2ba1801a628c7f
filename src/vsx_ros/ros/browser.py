"""Opens the live view in a browser of the desktop."""

import contextlib
import os
import subprocess
import sys
import threading

_IN_A_TERMINAL = {"elinks", "links", "links2", "lynx", "w3m", "www-browser"}


def open_browser(url: str) -> None:
    """Open the page if there is a display; returns at once. A browser of the terminal is left out: it would take the
    terminal away from the run. Whether one opens is unknown, so the address is to be told, too."""
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        threading.Thread(target=_open, args=(url,), name="browser", daemon=True).start()


def _open(url: str) -> None:
    """Many browsers are waited for until they are closed. In a session of its own Ctrl-C does not reach it."""
    command, nothing = [sys.executable, "-m", "webbrowser", url], subprocess.DEVNULL
    with contextlib.suppress(OSError):
        subprocess.run(
            command, env=_environment(), stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True,
            check=False,
        )  # fmt: skip


def _environment() -> dict[str, str]:
    """That of this process without browsers of the terminal; where TERM is not set, the module webbrowser looks for
    none."""
    chosen = [words for words in os.environ.get("BROWSER", "").split(os.pathsep) if words.strip()]
    kept = [words for words in chosen if os.path.basename(words.split()[0]) not in _IN_A_TERMINAL]
    others = {name: value for name, value in os.environ.items() if name not in ("BROWSER", "TERM")}
    return others | ({"BROWSER": os.pathsep.join(kept)} if kept else {})
