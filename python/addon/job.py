"""Operators that take a while."""

import time

import bpy

from .work import Waiting

# Seconds between two looks at a job.
PAUSE = 0.1
# Steps of the progress at the mouse pointer.
SCALE = 1000
# Blender raises ReferenceError about data that an undo, or a user, removed meanwhile. CumuloError is a RuntimeError.
FAULTS = (ValueError, OSError, RuntimeError, ReferenceError)


def labelled(what, steps):
    """Steps (done, of) of a generator as those of a Job, (done, of, what); returns what the generator returns."""
    try:
        while True:
            try:
                done, of = next(steps)
            except StopIteration as end:
                return end.value
            yield done, of, what
    finally:
        steps.close()


class Job:
    """Mixin of an operator whose work is a generator, `steps(context)`, of (done, of, what).

    With a window it goes on beside Blender's own events, shows its progress in the status bar, and ends on Esc. In
    background mode it runs to its end at once. What goes wrong is a report of Blender's.
    """

    # One job at a time: they share the scene and the machine.
    active = None

    @classmethod
    def poll(cls, context):
        """True while no job runs."""
        return Job.active is None

    @staticmethod
    def stop(context):
        """Ends the job that runs, if there is one."""
        if Job.active is not None:
            Job.active._end(context)

    def execute(self, context):
        """Does all of the work, and returns when it is done."""
        steps = self.steps(context)
        try:
            for step in steps:
                if isinstance(step, Waiting):
                    time.sleep(PAUSE)
        except FAULTS as fault:
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        finally:
            steps.close()
        return {"FINISHED"}

    def invoke(self, context, event):
        """Starts the work, which `modal` goes on with; without a window `execute` does all of it."""
        if bpy.app.background:
            return self.execute(context)
        return self.start(context)

    def start(self, context):
        """Starts the work beside Blender's events."""
        manager = context.window_manager
        self._steps = self.steps(context)
        self._timer = manager.event_timer_add(PAUSE, window=context.window)
        Job.active = self
        manager.progress_begin(0, SCALE)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Does the next step at each tick of a timer; Esc ends the work."""
        try:
            if event.type == "ESC" and event.value == "PRESS":
                self._end(context)
                self.report({"WARNING"}, f"{self.bl_label} was cancelled")
                return {"CANCELLED"}
            if event.type == "TIMER":
                self._show(context, *next(self._steps))
        except StopIteration:
            self._end(context)
            return {"FINISHED"}
        except FAULTS as fault:
            self._end(context)
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        except BaseException:
            # Blender drops an operator that fails so, and no other job could begin.
            self._end(context)
            raise
        # Ticks as well: other operators wait for those of theirs.
        return {"PASS_THROUGH"}

    def cancel(self, context):
        """Called by Blender when it closes the window or loads another file."""
        self._end(context)

    def _show(self, context, done, of, what):
        share = done / of if of else 0.0
        context.window_manager.progress_update(int(SCALE * share))
        # A single picture tells how much of it is done.
        counted = f" {int(done)} of {of}" if of > 1 else f" {share:.0%}" if of else ""
        context.workspace.status_text_set(f"Cumulo: {what}{counted}    Esc: cancel")

    def _end(self, context):
        """Ends the work, done or not, and takes its progress away."""
        if Job.active is self:
            Job.active = None
        try:
            self._steps.close()
        finally:
            # Where Blender ends, or loads another file, they may be gone before.
            timer, self._timer = self._timer, None
            manager = getattr(context, "window_manager", None)
            if timer and manager:
                manager.event_timer_remove(timer)
                manager.progress_end()
            if workspace := getattr(context, "workspace", None):
                workspace.status_text_set(None)
