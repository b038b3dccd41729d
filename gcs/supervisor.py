"""Starts a set of processes, watches them, restarts those that end, and stops them all, leaving none behind."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass

FIRST_RESTART_S = 0.5
LONGEST_RESTART_S = 8.0
GOOD_RUN_S = 30.0
STOP_TIMEOUT_S = 6.0
CONFIGURATION_FAULT = 2
LINE_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Program:
    """A process to keep: its name for people, and module with arguments."""

    name: str
    module: str
    arguments: tuple[str, ...]


class StartFault(Exception):
    """A process refused to start as configured; the text is what it said."""


@dataclass(slots=True)
class _Child:
    program: Program
    process: asyncio.subprocess.Process | None = None
    last_words: str = ""
    started_once: bool = False
    restart_s: float = FIRST_RESTART_S


class Supervisor:
    """Keeps programs running until :meth:`stop`.

    ``on_line(name, line, is_error)`` gets every line they print; ``on_event(text)`` every end and restart.
    """

    def __init__(self, on_line: Callable[[str, str, bool], None], on_event: Callable[[str], None]) -> None:
        self._on_line = on_line
        self._on_event = on_event
        self._children: list[_Child] = []
        self._stopping = asyncio.Event()

    @property
    def stopping(self) -> bool:
        return self._stopping.is_set()

    def stop(self) -> None:
        """End :meth:`run`; called twice, processes are killed without waiting for them."""
        if self._stopping.is_set():
            self._signal(self._children, signal.SIGKILL)
        self._stopping.set()

    async def run(self, programs: list[Program]) -> None:
        """Keep the programs running until stopped, then end them from the last to the first.

        Raises StartFault when a program's first start ends with the status of a wrong configuration.
        """
        self._children = [_Child(program) for program in programs]
        keepers = [asyncio.create_task(self._keep(child)) for child in self._children]
        stopping = asyncio.create_task(self._stopping.wait())
        try:
            await asyncio.wait([stopping, *keepers], return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._stopping.set()
            await self._end_all()
            stopping.cancel()
            results = await asyncio.gather(*keepers, return_exceptions=True)
        for result in results:
            if isinstance(result, BaseException):
                raise result

    async def _keep(self, child: _Child) -> None:
        loop = asyncio.get_running_loop()
        while not self._stopping.is_set():
            started_s = loop.time()
            status = await self._run_once(child)
            if self._stopping.is_set():
                return
            if status == CONFIGURATION_FAULT and not child.started_once:
                raise StartFault(child.last_words or f"{child.program.name} could not start")
            child.started_once = True
            if loop.time() - started_s > GOOD_RUN_S:
                child.restart_s = FIRST_RESTART_S
            wait_s, child.restart_s = child.restart_s, min(2.0 * child.restart_s, LONGEST_RESTART_S)
            self._on_event(f"{child.program.name} process ended ({describe_status(status)}), restart in {wait_s:g} s.")
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._stopping.wait(), wait_s)

    async def _run_once(self, child: _Child) -> int:
        program = child.program
        child.process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "gcs.child",
            str(os.getpid()),
            program.module,
            *program.arguments,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,
            limit=LINE_BYTES,
        )
        assert child.process.stdout is not None and child.process.stderr is not None
        await asyncio.gather(
            self._read(child, child.process.stdout, is_error=False),
            self._read(child, child.process.stderr, is_error=True),
        )
        return await child.process.wait()

    async def _read(self, child: _Child, stream: asyncio.StreamReader, *, is_error: bool) -> None:
        while raw := await stream.readline():
            line = raw.decode(errors="replace").rstrip()
            if is_error and line:
                child.last_words = line
            elif line:
                child.started_once = True  # A process prints when it is ready.
            self._on_line(child.program.name, line, is_error)

    async def _end_all(self) -> None:
        for child in reversed(self._children):
            process = child.process
            if process is None or process.returncode is not None:
                continue
            self._signal([child], signal.SIGTERM)
            try:
                await asyncio.wait_for(process.wait(), STOP_TIMEOUT_S)
            except TimeoutError:
                self._on_event(f"{child.program.name} process does not stop, killed.")
                self._signal([child], signal.SIGKILL)
                await process.wait()

    @staticmethod
    def _signal(children: list[_Child], number: signal.Signals) -> None:
        for child in children:
            if child.process is not None and child.process.returncode is None:
                # Each leads a group of its own; the group may be gone by now.
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(child.process.pid, number)


def describe_status(status: int) -> str:
    """Exit status in words."""
    if status >= 0:
        return f"exit status {status}"
    with contextlib.suppress(ValueError):
        return f"killed by {signal.Signals(-status).name}"
    return f"killed by signal {-status}"
