"""Work of Cumulo beside Blender's events, in Blender's own process."""

import threading

import cumulo

# Seconds that Blender waits for work that was told to stop. What has not ended then ends by itself.
PATIENCE = 5.0

# Threads of work that was stopped and has not ended.
_ending: list[threading.Thread] = []


class Stopped(Exception):
    """Raised where work tells of its progress, which stops it."""


class Waiting(tuple):
    """A step (done, of, what) of work on another thread, on which there is nothing to do but to wait."""


class Work:
    """A command that runs on a thread of its own."""

    def __init__(self, words):
        """Starts the command of these words, as `cumulo.call` takes them."""
        self.progress = (0, 0, str(words[0]))
        self._stages, self._stop = {}, threading.Event()
        self._report = self._failure = None
        # Not a daemon: Blender may not quit under it.
        self._thread = threading.Thread(target=self._do, args=(words,), name="cumulo")
        self._thread.start()

    def _do(self, words):
        try:
            self._report = cumulo.call(*words, progress=self._hear)
        except BaseException as failure:  # noqa: BLE001  raised again by `report`
            self._failure = failure

    def _hear(self, event):
        """Keeps the progress of the stage that an event tells of."""
        if self._stop.is_set():
            raise Stopped
        kind = event["event"]
        if kind == "began":
            self._stages[event["stage"]] = event["name"]
            self.progress = (0, event["total"] or 0, event["name"])
        elif kind == "advanced":
            self.progress = (event["done"], event["total"] or 0, self._stages.get(event["stage"], ""))

    def running(self):
        """True until the command has ended."""
        return self._thread.is_alive()

    def stop(self):
        """Stops the command, and waits for its end."""
        self._stop.set()
        self._thread.join(PATIENCE)
        if self._thread.is_alive():
            _ending.append(self._thread)

    def report(self):
        """The report as a dict, once the command has ended. Raises `cumulo.CumuloError` where it refused."""
        self._thread.join()
        if self._failure is not None:
            raise self._failure
        return self._report


def run(words):
    """Runs a command: a generator of Waiting, which returns the report. Closing it stops the command."""
    while _ending:
        if _ending[-1].is_alive():
            yield Waiting((0, 0, "the work before ends"))
        else:
            _ending.pop()
    work = Work(words)
    try:
        while work.running():
            yield Waiting(work.progress)
        return work.report()
    finally:
        work.stop()
