"""The processes that a cluster is made of."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import httpx

ROOT = Path(__file__).parents[1]
PORT = "PORT"
START_S, STOP_S = 60.0, 30.0
POLL_S = 0.02


@dataclass
class Part:
    """One process of a cluster, which can be stopped and started again.

    log: where its output goes; port: its own, whether it listens there or not.
    """

    command: tuple[str, ...]
    environment: Mapping[str, str]
    log: Path
    port: int
    process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        """Where it is reached."""
        return f"http://127.0.0.1:{self.port}"

    def start(self) -> None:
        """Start it, and return at once."""
        with self.log.open("ab") as output:
            self.process = subprocess.Popen(
                self.command,
                cwd=ROOT,
                env={**os.environ, **self.environment},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
            )

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal, and return at once."""
        if self.process is not None:
            self.process.send_signal(number)

    def wait(self) -> int:
        """Wait until it has ended; return its exit code."""
        return 0 if self.process is None else self.process.wait(STOP_S)

    def kill(self) -> None:
        """End it with SIGKILL."""
        self.signal(signal.SIGKILL)
        self.wait()

    def terminate(self) -> int:
        """End it with SIGTERM; return its exit code."""
        self.signal(signal.SIGTERM)
        return self.wait()

    def restart(self) -> None:
        """End it in order and start it again."""
        self.terminate()
        self.start()

    def end(self) -> None:
        """End it, in order where it can."""
        if self.process is None or self.process.poll() is not None:
            return
        try:
            self.terminate()
        except subprocess.TimeoutExpired:
            self.kill()

    def await_answer(self, path: str = "/readyz") -> float:
        """Wait until it answers well, at ``url``; return when that was, by the monotonic clock [s]."""
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline:
            try:
                if httpx.get(self.url + path, timeout=START_S).is_success:
                    return time.monotonic()
            except httpx.TransportError:
                pass
            if self.process is None or self.process.poll() is not None:
                break
            time.sleep(POLL_S)
        raise RuntimeError(f"{self.command} does not answer: {self.log.read_text()[-2000:]}")


def part(folder: Path, name: str, *words: str, **environment: str) -> Part:
    """Return a part that runs Python with these words, of which ``PORT`` becomes one that is free."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    command = (sys.executable, *(str(port) if word == PORT else word for word in words))
    return Part(command, environment, folder / f"{name}.log", port)
