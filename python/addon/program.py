"""Runs the program beside Blender."""

import json
import re
import subprocess
import threading

# Progress where standard error is no terminal: "views: 3 of 24 after 2s, 10s to go; …".
PROGRESS = re.compile(r"^(?P<what>[^:]+): (?P<done>\d+) of (?P<of>\d+) after ")
# Seconds that the program has to end once it is told to.
PATIENCE = 5.0
# Lines of a message that a report of Blender's shows.
MOST_LINES = 12


class ProgramError(RuntimeError):
    """The program refused; the message is what it said, hint included."""


class Process:
    """One command that runs."""

    def __init__(self, words):
        """Starts the program `words[0]` with the other words and `--json`."""
        self.words = [*map(str, words), "--json"]
        self.progress = (0, 0, words[1] if len(words) > 1 else "")
        try:
            self._child = subprocess.Popen(
                self.words,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                # No console beside Blender on Windows.
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            raise ProgramError(f"{self.words[0]} cannot be started: {error}") from error
        self._out, self._said = "", []
        self._readers = [threading.Thread(target=read, daemon=True) for read in (self._read_out, self._read_said)]
        for reader in self._readers:
            reader.start()

    def _read_out(self):
        self._out = self._child.stdout.read()

    def _read_said(self):
        for line in self._child.stderr:
            if found := PROGRESS.match(line):
                self.progress = (int(found["done"]), int(found["of"]), found["what"])
            else:
                self._said.append(line.rstrip())

    def running(self):
        """True until the program has ended."""
        return self._child.poll() is None

    def stop(self):
        """Ends the program, at once if it does not end by itself."""
        if self.running():
            self._child.terminate()
            try:
                self._child.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()
        self._join()

    def _join(self):
        for reader, pipe in zip(self._readers, (self._child.stdout, self._child.stderr)):
            # What the program left running may hold the other end.
            reader.join(PATIENCE)
            if not reader.is_alive():
                pipe.close()

    def report(self):
        """The report as a dict, once the program has ended. Raises ProgramError where it refused."""
        self._child.wait()
        self._join()
        if self._child.returncode not in (0, 1):
            raise ProgramError(self._message())
        try:
            return json.loads(self._out)
        except ValueError as error:
            raise ProgramError(f"{' '.join(self.words)} gave no report; is it a cumulo of this version?") from error

    def _message(self):
        """What the program said of its failure: from its own line on."""
        starts = [i for i, line in enumerate(self._said) if line.startswith("cumulo: ")]
        said = [line for line in self._said[starts[-1] if starts else 0 :] if line.strip()]
        if len(said) > MOST_LINES:
            said[MOST_LINES:] = [f"… {len(said) - MOST_LINES} lines more"]
        return (
            "\n".join(said).removeprefix("cumulo: ")
            or f"{' '.join(self.words)} ended with code {self._child.returncode}, and said nothing"
        )


class Waiting(tuple):
    """A step (done, of, what) of another process, on which there is nothing to do but to wait."""


def run(words):
    """Runs a command: a generator of Waiting, which returns the report. Closing it ends the program."""
    process = Process(words)
    try:
        while process.running():
            yield Waiting(process.progress)
        return process.report()
    finally:
        process.stop()
