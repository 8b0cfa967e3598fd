"""What a scene holds that Cumulo cannot honor."""

import contextlib
import dataclasses


@dataclasses.dataclass(frozen=True)
class Complaint:
    """A part of a scene that Cumulo would show as something else: the object and the node, what was found, and what to do.

    `without` says what an export does where it leaves the part out; it is None of what cannot be left out.
    """

    where: str
    found: str
    remedy: str
    without: str | None = None

    def __str__(self):
        return f"{self.where}: {self.found}; {self.remedy}"

    def left_out(self):
        """What the export does without the part, in words."""
        return f"{self.where}: {self.found}; {self.without}"


class Refused(ValueError):
    """Parts of a scene that Cumulo would show as something else, of which the message names each with a remedy.

    `complaints` are the parts, and `can_be_left_out` is true where an export can do without all of them.
    """

    def __init__(self, *complaints):
        super().__init__("\n".join(map(str, complaints)))
        self.complaints = complaints
        self.can_be_left_out = all(complaint.without for complaint in complaints)


class Complaints:
    """The complaints about a scene, in the order in which they were found."""

    def __init__(self, ignore=False):
        """With `ignore`, what can be left out is, and is recorded in `left_out`."""
        self.ignore = ignore
        # A part of several frames, or of several instances, is named once.
        self._found = {}

    def add(self, complaint):
        """Adds one."""
        self._found.setdefault(str(complaint), complaint)

    @contextlib.contextmanager
    def gathered(self):
        """Adds the complaints of a Refused that is raised inside, and goes on after the block."""
        try:
            yield
        except Refused as refused:
            for complaint in refused.complaints:
                self.add(complaint)

    @property
    def stops(self):
        """True if one of them is about what cannot be left out."""
        return any(complaint.without is None for complaint in self._found.values())

    def settle(self):
        """Raises Refused about all that was found, unless all of it is left out."""
        if self._found and (self.stops or not self.ignore):
            raise Refused(*self._found.values())

    @property
    def found(self):
        """The complaints."""
        return tuple(self._found.values())

    @property
    def left_out(self):
        """What was left out, in words."""
        return tuple(complaint.left_out() for complaint in self._found.values() if complaint.without)


def refused(where, found, remedy):
    """The Refused of one part that cannot be left out."""
    return Refused(Complaint(where, found, remedy))


def named(kind, block, node=None):
    """How messages name a data block, and a node in it."""
    return f"{kind} {block.name!r}" + (f", node {node.name!r}" if node is not None else "")
